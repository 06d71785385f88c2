"""Filters as products of matrices, against those of scipy and a sum that is written out."""

import numpy as np
import pytest
from scipy.signal import lfilter

from faultgen.recordings.block_filter import block_filter, blocks_of

PARTS = [slice(0, 30), slice(30, 31), slice(31, 300)]
"""Recordings shorter than the order, of a single sample, and of several blocks."""


@pytest.fixture
def rng():
    return np.random.default_rng(4)


@pytest.mark.parametrize("order", [0, 1, 40])
def test_each_recording_is_filtered_as_by_scipy(rng, order):
    x, taps = rng.standard_normal((70, 300)), rng.standard_normal(order + 1)
    wanted = np.concatenate([lfilter(taps, 1.0, x[:, part]) for part in PARTS], axis=1)
    found = block_filter(x, blocks_of(PARTS), taps[None])
    np.testing.assert_allclose(found, wanted, atol=1e-12)
    single = block_filter(x[0].astype(np.float32), blocks_of(PARTS), taps[None])
    assert single.dtype == np.float32 and single.shape == (300,)
    np.testing.assert_allclose(single, wanted[0], atol=1e-4)


def test_samples_of_another_frame_have_other_taps(rng):
    """What came before is seen through the taps of the sample's own frame."""
    frame = np.repeat(np.arange(12), 25)
    taps, x = rng.standard_normal((12, 6)), rng.standard_normal(300)
    blocks = blocks_of(PARTS, frame)
    found = block_filter(x, blocks, taps[frame[blocks.start]])
    wanted = np.zeros(300)
    for part in PARTS:
        for t in range(part.start, part.stop):
            for k in range(min(6, t - part.start + 1)):
                wanted[t] += taps[frame[t], k] * x[t - k]
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_nothing_is_filtered_outside_of_the_recordings(rng):
    x = rng.standard_normal(300)
    found = block_filter(x, blocks_of([slice(10, 20)]), np.ones((1, 3)))
    assert found[10:20].all() and not found[:10].any() and not found[20:].any()
