"""Effects for the cases that no catalogue entry describes, and those of the torque sensor.

The severity of each is an amplitude of its own. Some of these names
may join the catalogue: a case then says that the name is to be left out.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter
from sealed.effects import Context, Effect, Slow
from sealed.physics import SAMPLE_PERIOD, Physics

UNLISTED = (
    "seizing_spot",
    "tooth_damage",
    "periodic_friction",
    "acceleration_friction",
    "servo_gain",
    "current_clipping",
    "brake_drag_intermittent",
    "sensor_dropout",
    "sensor_stuck",
    "torque_lowpass",
)
"""Names; `catalogue_name` is what the catalogue would call them."""


def catalogue_name(name: str) -> str:
    """Name under which the catalogue might have an unlisted effect."""
    return {"brake_drag_intermittent": "brake_drag"}.get(name, name)


def apply_unlisted(
    effect: Effect, physics: Physics, where: Context, slow: Slow
) -> tuple[Physics, Slow]:
    """Put an unlisted effect into a robot; those of the torque sensor change nothing here.

    Args:
        effect: The effect; details ``at`` (rad, or a share) and ``seed`` where it needs them.
        physics: The robot.
        where: The nominal robot.
        slow: What changes with time so far; not changed.

    Returns:
        The changed robot and what changes with time.
    """
    axis, s, row = effect.axis, effect.severity, effect.axis - 1
    x, at = where.axis(axis), effect.details.get("at", 0.5)
    if effect.name == "seizing_spot":
        low, high = np.quantile(x.q, [0.1, 0.9])
        width = 0.08 * (x.q.max() - x.q.min())
        physics = physics.changed(
            axis, SPOT=s, SPOT_AT=float(low + at * (high - low)), SPOT_WIDTH=float(width)
        )
    elif effect.name == "tooth_damage":
        physics = physics.changed(axis, TOOTH=s, TOOTH_AT=2 * np.pi * at, TOOTH_WIDTH=0.35)
    elif effect.name == "periodic_friction":
        physics = physics.changed(axis, PERIODIC=s, PERIODIC_ORDER=1.0)
    elif effect.name == "acceleration_friction":
        change = np.abs(np.diff(x.w)) / SAMPLE_PERIOD
        time = 0.02
        physics = physics.changed(
            axis, LAG=s, LAG_TIME=time, LAG_W=float(0.2 * np.quantile(change, 0.9) * time)
        )
    elif effect.name == "servo_gain":
        physics = physics.changed(
            axis,
            KP=float(physics.column("KP")[row]) * (1 - s),
            KD=float(physics.column("KD")[row]) * (1 - s),
        )
    elif effect.name == "current_clipping":
        # a limit that falls with speed; at severity 0 it touches the nominal protocol's torques
        speed = np.maximum(np.abs(x.w), 1e-3)
        peak = int(np.argmin((1 - np.abs(x.torque) / x.LIMIT) / speed))
        allowed = (1 - s) * abs(x.torque[peak]) / x.LIMIT
        physics = physics.changed(axis, CLIP=float(1 - allowed), CLIP_W=float(speed[peak]))
    elif effect.name == "brake_drag_intermittent":
        slow = [part.copy() for part in slow]
        rng = np.random.default_rng(int(effect.details.get("seed", 1)))
        for part in slow:
            for _ in range(2):
                start = int(rng.integers(len(part) - 150))
                part[start : start + int(rng.integers(60, 150)), row, 3] += s
    elif effect.name not in ("sensor_dropout", "sensor_stuck", "torque_lowpass"):
        raise ValueError(f"no unlisted effect '{effect.name}'")
    return physics, slow


def sensed(effect: Effect, torque: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """What a torque sensor with an effect sees of one motion.

    Args:
        effect: Of dropout and stuck, severity is the share of time; of the low-pass, its time
            constant [s]. Others leave the torque as it is.
        torque: Shape (samples, n_axes), in [N m].
        rng: Where the bursts are.

    Returns:
        The torque seen, same shape.
    """
    row = effect.axis - 1
    if effect.name == "torque_lowpass":
        keep = np.exp(-SAMPLE_PERIOD / effect.severity)
        seen = torque.copy()
        first = torque[:1, row]
        seen[:, row] = first + lfilter([1 - keep], [1, -keep], torque[:, row] - first)
        return seen
    if effect.name not in ("sensor_dropout", "sensor_stuck"):
        return torque
    seen = torque.copy()
    length = 6
    bursts = max(1, round(min(effect.severity, 0.5) * len(torque) / length))
    for start in rng.integers(20, len(torque) - length, bursts):
        held = 0.0 if effect.name == "sensor_dropout" else seen[start, row]
        seen[start : start + length, row] = held
    return seen
