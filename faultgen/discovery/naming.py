"""Naming effects: added one at a time, chosen on other motions than they are fitted on.

The gap is the difference between a robot and its healthy twin on the same motions. Effects are
probed by re-simulation, screened to first order, and their severities refined by re-simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed

from faultgen.discovery.noise import Noise, noise_of
from faultgen.discovery.recording import Recording
from faultgen.discovery.replay import Effects, relative_error, replay, settled
from faultgen.discovery.screen import Candidate, sensitivities
from faultgen.effects import get_effect
from faultgen.robot import STRIBECK_VELOCITY, Robot

MOST = 4
"""Effects that are added at most."""

SHARE = 0.03
"""Smallest share of the gap that an effect has to explain: assumed."""

_SURE = 30.0  # chi-square of an effect on the motions that it is chosen on; one in 1e7 by chance
_ALTERNATIVE = 10.0  # chi-square by which another effect may be worse and still not be excluded
_LEFT = 0.05  # share of the gap, unexplained, from which the effect is not in the catalogue
_STEPS = 3  # Gauss-Newton steps by re-simulation
_JUMP = 0.05  # time around a change of direction in which the noise is not looked for [s]
_SIGNED = ("torque_offset", "gravity_spring", "payload_mass", "payload_offset", "rotor_inertia")
_SAME = ("brake_drag",)  # the edit of coulomb_friction in another unit


@dataclass(frozen=True)
class Named:
    """One effect that was added."""

    effect: str
    """Name."""
    axis: int
    """From 1."""
    severity: float
    """In the unit of the effect."""
    error: float
    """Standard error of the severity, from the noise."""
    confidence: float
    """Probability against its alternatives, all being equally likely before."""
    gap_after: float
    """RMS torque error over RMS torque after this effect, on the motions it was chosen on."""
    alternatives: tuple[tuple[Candidate, float], ...] = ()
    """Candidates that the data do not exclude in its place, and their probability."""


@dataclass(frozen=True, eq=False)
class Naming:
    """What was found."""

    effects: tuple[Named, ...]
    """In the order added."""
    gap_before: float
    """RMS torque error over RMS torque, on the motions used for choosing."""
    gap_after: float
    """The same with the effects in the model."""
    floor: float
    """The same for noise alone."""
    excess_before: float
    """Mean square of the whitened gap on those motions, less the 1 of noise alone."""
    excess_after: float
    """The same with the effects in the model."""
    excess_error: float
    """Standard deviation of either by chance."""
    by_axis: tuple[float, ...]
    """Share of each axis in the gap before."""
    change: np.ndarray
    """Torque that the effects make, on the recorded motions, shape (samples, n_axes)."""

    @property
    def significant(self) -> bool:
        """Whether there is a gap at all."""
        return self.excess_before > 4 * self.excess_error

    @property
    def explained(self) -> bool:
        """Whether the effects leave no more of it than they may."""
        left = max(self.excess_after, 0.0)
        return left < max(_LEFT * self.excess_before, 4 * self.excess_error)


def to_probe(names: Sequence[Candidate]) -> list[Candidate]:
    """Candidates less those that are the same edit as another one."""
    return [name for name in names if name[0] not in _SAME]


def name_effects(
    gap: np.ndarray,
    healthy: Recording,
    robot: Robot,
    names: Sequence[Candidate],
    *,
    workers: int = 1,
) -> Naming:
    """Name the effects that make a gap.

    Args:
        gap: Torque measured less that of the healthy twin, same motion, shape (samples, n_axes), on
            the recording's side.
        healthy: Recording of the healthy twin.
        robot: Its model.
        names: Candidates.
        workers: Processes; no effect on the result.

    Returns:
        What was found; perhaps nothing.

    Raises:
        ValueError: An axis moves too little to tell its noise.
        SimulationFailed: A simulation diverged.
    """
    inside = settled(healthy, robot)
    parts = healthy.parts
    base = replay(healthy, robot)
    choosing = _choosing(healthy)
    # of the twin, which has no effect that could pass for noise; both recordings have as much
    single = noise_of(healthy.torque - base, inside & ~_jumps(healthy, robot), parts)
    noise = Noise(single.memory, np.sqrt(2) * single.innovation)
    changes = sensitivities(healthy, robot, names, workers=workers)
    problem = _Problem(healthy, robot, inside, parts, noise, choosing, workers)
    named: list[Candidate] = []
    severity = np.zeros(0)
    explained = np.zeros_like(gap)
    white = problem.white(changes)
    target = problem.white(gap)
    first = problem.excess(target)
    found: list[Named] = []
    for _ in range(MOST):
        left = problem.white(gap - explained)
        best = _best(left, white, names, named, choosing)
        if best is None or best[1] < max(_SURE, SHARE * first * choosing.sum()):
            break
        named = [*named, names[best[0]]]
        start = np.append(severity, best[2])
        severity, error, explained = problem.refine(gap, base, named, start)
        after = [*(one.gap_after for one in found), problem.relative(gap - explained)]
        found = [
            Named(
                effect=name,
                axis=axis,
                severity=float(s),
                error=float(e),
                confidence=1.0,
                gap_after=left_over,
            )
            for (name, axis), s, e, left_over in zip(named, severity, error, after, strict=True)
        ]
    chosen = _with_alternatives(found, target, white, names)
    energy = (np.where(choosing[:, None], target, 0.0) ** 2).sum(axis=0)
    energy = np.maximum(energy - (choosing[:, None] & problem.counted).sum(axis=0), 0.0)
    return Naming(
        effects=tuple(chosen),
        gap_before=problem.relative(gap),
        gap_after=problem.relative(gap - explained),
        floor=problem.relative(noise.deviation),
        excess_before=first,
        excess_after=problem.excess(problem.white(gap - explained)),
        excess_error=float(np.sqrt(2 / max((choosing[:, None] & problem.counted).sum(), 1))),
        by_axis=tuple((energy / max(energy.sum(), 1e-300)).tolist()),
        change=explained,
    )


def _jumps(recording: Recording, robot: Robot) -> np.ndarray:
    """Samples about a change of direction, where friction jumps; shape (samples, n_axes)."""
    ratio = np.ones(robot.n_axes) if recording.side == "motor" else np.abs(robot.gear_ratio)
    friction = robot.ids("actuator", "friction")
    slow = 3 * robot.model.actuator_biasprm[friction, STRIBECK_VELOCITY]
    width = max(1, round(_JUMP / recording.sample_period))
    near = np.zeros(recording.position.shape, bool)
    for part in recording.parts:
        speed = np.gradient(recording.position[part], recording.sample_period, axis=0) * ratio
        still = np.abs(speed) < slow
        for axis in range(robot.n_axes):
            spread = np.convolve(still[:, axis].astype(int), np.ones(2 * width + 1, int), "same")
            near[part, axis] = spread > 0
    return near


def _choosing(recording: Recording) -> np.ndarray:
    """Samples on which effects are chosen: the last third of the recordings, or of a single one."""
    parts = recording.parts
    mask = np.zeros(len(recording.position), bool)
    if len(parts) > 1:
        for part in parts[-max(1, len(parts) // 3) :]:
            mask[part] = True
    else:
        mask[2 * len(mask) // 3 :] = True
    return mask


def _best(
    left: np.ndarray,
    white: np.ndarray,
    names: Sequence[Candidate],
    named: Sequence[Candidate],
    choosing: np.ndarray,
) -> tuple[int, float, float] | None:
    """Candidate, chi-square that it saves where effects are chosen, severity fitted elsewhere."""
    fit, choose = left[~choosing], left[choosing]
    best: tuple[int, float, float] | None = None
    for index, name in enumerate(names):
        if name in named:
            continue
        x, y = white[index][~choosing], white[index][choosing]
        size = float((x * x).sum())
        if size <= 0:
            continue
        severity = float((x * fit).sum()) / size
        if severity <= 0 and name[0] not in _SIGNED:
            continue
        saved = float((choose**2).sum() - ((choose - severity * y) ** 2).sum())
        certain = severity**2 * size
        if certain > _SURE and (best is None or saved > best[1]):
            best = index, saved, severity
    return best


def _with_alternatives(
    found: Sequence[Named], target: np.ndarray, white: np.ndarray, names: Sequence[Candidate]
) -> list[Named]:
    """Each effect with those that would do about as well in its place, to first order."""
    index = {name: k for k, name in enumerate(names)}
    own = [index[n.effect, n.axis] for n in found]
    flat = white.reshape(len(names), -1)
    goal = target.ravel()

    def misfit(columns: list[int]) -> float:
        design = flat[columns].T
        answer, *_ = np.linalg.lstsq(design, goal, rcond=None)
        return float(((goal - design @ answer) ** 2).sum())

    out = []
    least = misfit(own) if own else 0.0
    for position, one in enumerate(found):
        worse: list[tuple[Candidate, float]] = []
        for k, name in enumerate(names):
            if k in own:
                continue
            other = [*own[:position], k, *own[position + 1 :]]
            more = misfit(other) - least
            if more < _ALTERNATIVE:
                worse.append((name, more))
        odds = np.exp([-max(more, 0.0) / 2 for _, more in worse])
        total = 1 + float(odds.sum())
        others = tuple(
            (name, float(odd) / total) for (name, _), odd in zip(worse, odds, strict=True)
        )
        out.append(replace(one, confidence=1 / total, alternatives=others))
    return out


@dataclass(frozen=True, eq=False)
class _Problem:
    recording: Recording
    robot: Robot
    inside: np.ndarray
    parts: Sequence[slice]
    noise: Noise
    choosing: np.ndarray
    workers: int

    @property
    def counted(self) -> np.ndarray:
        """Samples whose innovation counts."""
        counted = self.inside.copy()
        for part in self.parts:
            counted[part.start] = False
        return counted

    def white(self, x: np.ndarray) -> np.ndarray:
        return self.noise.whiten(x, self.parts) * self.counted

    def excess(self, white: np.ndarray) -> float:
        """Mean square on the choosing samples, less 1."""
        count = (self.choosing[:, None] & self.counted).sum()
        return float((white[self.choosing] ** 2).sum() / max(count, 1)) - 1

    def relative(self, error: np.ndarray) -> float:
        """RMS error over RMS torque on the choosing samples, root mean square over the axes."""
        use = self.inside & self.choosing[:, None]
        return relative_error(error**2, self.recording, use)

    def refine(
        self, gap: np.ndarray, base: np.ndarray, named: Sequence[Candidate], start: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Severities by Gauss-Newton with re-simulation, their errors, and what they explain."""
        severity = start.copy()
        explained = self._simulated(named, severity) - base
        for _ in range(_STEPS):
            columns = self._slopes(named, severity, explained + base)
            design = self.white(columns).reshape(len(named), -1).T
            step, *_ = np.linalg.lstsq(design, self.white(gap - explained).ravel(), rcond=None)
            new = severity + step
            for k, (name, _) in enumerate(named):
                if name not in _SIGNED:
                    new[k] = np.clip(new[k], 0.1 * severity[k], get_effect(name).largest)
            tried = self._simulated(named, new) - base
            if self._misfit(gap - tried) >= self._misfit(gap - explained):
                break
            severity, explained = new, tried
        error = np.sqrt(np.diag(np.linalg.pinv(design.T @ design)))
        return severity, error, explained

    def _misfit(self, gap: np.ndarray) -> float:
        return float((self.white(gap) ** 2).sum())

    def _simulated(self, named: Sequence[Candidate], severity: np.ndarray) -> np.ndarray:
        return replay(self.recording, self.robot, _effects(named, severity))

    def _slopes(
        self, named: Sequence[Candidate], severity: np.ndarray, here: np.ndarray
    ) -> np.ndarray:
        steps = [
            0.2 * abs(s) or get_effect(n).step for (n, _), s in zip(named, severity, strict=True)
        ]
        moved = [severity + step * (np.arange(len(named)) == k) for k, step in enumerate(steps)]
        runs = Parallel(n_jobs=min(self.workers, len(named)))(
            delayed(replay)(self.recording, self.robot, _effects(named, s)) for s in moved
        )
        return np.stack([(run - here) / step for run, step in zip(runs, steps, strict=True)])


def _effects(named: Sequence[Candidate], severity: np.ndarray) -> Effects:
    return [(name, axis, float(s)) for (name, axis), s in zip(named, severity, strict=True)]
