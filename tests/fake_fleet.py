"""A fleet of random arrays: robots whose torque drifts and gets unsteady before they fail."""

import numpy as np

from faultgen.fleet.data import Fleet, FleetRobot

BINS = 12


def shares(rng, centre, days, n_axes, count=2000):
    """Histograms of so many samples around centres that differ by axis."""
    edges = np.arange(BINS) + 0.5
    weights = np.exp(-0.5 * ((edges - centre[..., None]) / 1.5) ** 2)
    weights /= weights.sum(axis=-1, keepdims=True)
    return np.array(
        [
            [rng.multinomial(count, weights[d, a]) / count for a in range(n_axes)]
            for d in range(days)
        ]
    )


def fake_robot(rng, name, failed, *, days, n_axes=6, a_day=1, worst=0.5):
    """One robot; a failing one's torque grows by `worst` over its last 20 days, unsteadily."""
    n = days * a_day
    day = (np.arange(n) + 1) / a_day
    axis = int(rng.integers(1, n_axes + 1)) if failed else 0
    production = rng.uniform(0.3, 0.9) * rng.uniform(0.8, 1.0, n)
    level = np.exp(rng.normal(0, 0.5, n_axes))
    torque = level * (1 + 0.02 * rng.standard_normal((n, n_axes)))
    grows = np.clip((day - days + 20) / 20, 0, None)
    if failed:
        torque[:, axis - 1] *= 1 + worst * grows * np.exp(0.3 * rng.standard_normal(n))
    speed = rng.uniform(20, 150, n_axes) * (1 + 0.02 * rng.standard_normal((n, n_axes)))
    centre = 4 + 4 * rng.random((1, n_axes)) + 1.5 * (torque / level - 1)
    still = np.broadcast_to(4 + 4 * rng.random((1, n_axes)), (n, n_axes))
    return FleetRobot(
        name=name,
        robot="puma560",
        failed=failed,
        axis=axis,
        day=day,
        production=production,
        torque_histogram=shares(rng, centre, n, n_axes),
        speed_histogram=shares(rng, still, n, n_axes),
        angle_histogram=shares(rng, still, n, n_axes),
        torque_indicator=torque * production[:, None] ** 0.3,
        speed_indicator=speed * production[:, None],
        temperature=25 + rng.standard_normal(n),
        events=rng.poisson(1.0, (days, 67)),
        truth={},
    )


def fake_fleet(*, failed=4, normal=4, days=60, n_axes=6, a_day=1, worst=0.5, seed=0):
    """A fleet of such robots, the failing ones first."""
    rng = np.random.default_rng(seed)
    robots = tuple(
        fake_robot(
            rng, f"robot{k + 1:03d}", k < failed, days=days, n_axes=n_axes, a_day=a_day, worst=worst
        )
        for k in range(failed + normal)
    )
    return Fleet(
        robots=robots,
        event_names=tuple(f"event{k}" for k in range(67)),
        days=days,
        seed=seed,
        attributes={},
    )
