"""Limit of Q from rows that were not fitted."""

import numpy as np
import pytest
from faultgen.analysis import PCAMonitor, held_out_q_limit


def test_kept_by_healthy_rows_that_were_not_fitted():
    """With more columns than rows, one in twenty; by Jackson and Mudholkar nearly all."""
    rng = np.random.default_rng(0)
    held_out, gaussian = [], []
    for _ in range(8):
        train, new = rng.standard_normal((40, 45)), rng.standard_normal((200, 45))
        monitor = PCAMonitor(n_components=0.9).fit(train)
        held_out.append(np.mean(monitor.q(new) > held_out_q_limit(monitor, train)))
        gaussian.append(np.mean(monitor.q(new) > monitor.q_limit_))
    assert 0.01 < np.mean(held_out) < 0.12
    assert np.mean(gaussian) > 0.5


def test_with_many_rows_both_limits_agree():
    rng = np.random.default_rng(1)
    X = rng.standard_normal((20_000, 8)) @ rng.standard_normal((8, 8))
    monitor = PCAMonitor(n_components=3).fit(X)
    assert held_out_q_limit(monitor, X) == pytest.approx(monitor.q_limit_, rel=0.05)


@pytest.mark.parametrize("blocks", [1, 11])
def test_wrong_number_of_blocks(blocks):
    with pytest.raises(ValueError, match=f"10 rows, got {blocks}"):
        held_out_q_limit(PCAMonitor(), np.eye(10), blocks=blocks)
