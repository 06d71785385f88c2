"""The detector of `faultgen train`, which monitors robots, at severities that the ideal one sees.

It learns from healthy cycles as from recordings of a robot, one recording for each logged cycle,
and judges simulated cycles with an effect as `faultgen judge` judges recordings: each cycle is
found by its positions, and the whole sequence since the robot was healthy counts.

    one.limit(EFFECTS["backlash"], 1, bench, first=1e-6, days=40, rng=rng)["severity"]

`faultgen.studies.detectability.training` trains it.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from faultgen.analysis.fitted_posterior import lengths_of
from faultgen.effects import Effect
from faultgen.errors import InputError
from faultgen.recordings.recording import Recording
from faultgen.studies.detectability.ideal import DETECTED, FALSE_ALARM, LOGGED
from faultgen.studies.detectability.limits import Bench
from faultgen.twin.alignment import find_cycles
from faultgen.twin.columns import TEMPERATURE
from faultgen.twin.detector import Detector

BEFORE = 24
"""Healthy recordings before a day that is judged."""

LONGEST = 30 * LOGGED
"""Recordings up to which the time to detection is followed: one month."""

MULTIPLES = (0.5, 1.0, 2.0)
"""Multiples of the limit for which the time to detection is given."""

_ROBOTS = 30  # for the time to detection
_TIMES = 1.25  # ratio of the numbers of recordings at which an alarm is looked for first
_LEVELS, _RATIO = 6, 4.0  # severities that are tried, and the ratio of one to the next
_HALVINGS = 3  # of the logarithm of this ratio: limits are found to within 19 %


@dataclass(frozen=True, eq=False)
class LearnedDetector:
    """A detector for one robot and task, with healthy recordings to judge."""

    detector: Detector
    """The detector."""
    healthy: np.ndarray
    """A healthy cycle at the rate of the log, shape (3, samples, n_axes): position [rad], velocity
    [rad/s] and torque [N m] of the motors."""
    every: int
    """Every so many-th simulated sample is logged."""
    pool: np.ndarray
    """Scores of healthy recordings that it has not learned from, shape (recordings, columns)."""
    stated: float
    """Limit of its statistic that should hold its promised rate; `with_limit_of` sets another."""

    def with_limit_of(self, days: int, rng: np.random.Generator) -> LearnedDetector:
        """Raise its limit until it keeps its promise on healthy days.

        Args:
            days: Number of healthy days.
            rng: Source of randomness.

        Returns:
            Itself. As for the other detectors, one of 30 of these days raises an alarm, or fewer.
        """
        tops = self.tops(self.pool[self.recordings(days, BEFORE + LOGGED, rng)])
        found = float(np.quantile(tops, 1 - FALSE_ALARM))
        self.detector.posterior.limit_ = max(self.stated, found)
        return self

    def tops(self, scores: np.ndarray) -> np.ndarray:
        """Compute the largest statistic of each day, after any of its recordings.

        Args:
            scores: Of the recordings before the day and on it, shape (days, recordings, columns).

        Returns:
            Shape (days,).
        """
        ends = range(scores.shape[1] - LOGGED + 1, scores.shape[1] + 1)
        return np.max([self._statistic(scores[:, :end]) for end in ends], axis=0)

    def shift(self, cycle: np.ndarray) -> np.ndarray | None:
        """Compute by how much an effect changes the scores of a recording.

        Args:
            cycle: Simulated cycle with the effect, shape (3, simulated samples, n_axes).

        Returns:
            Shape (columns,); None if the cycle is no longer the motion of the task.
        """
        try:
            changed = self._found(cycle[:, :: self.every])
        except InputError:
            return None
        detector = self.detector
        change = changed - self._found(self.healthy)
        shift = detector.program.features(change) @ detector.posterior.projection_
        return np.asarray(shift, self.pool.dtype)

    def _found(self, cycle: np.ndarray) -> np.ndarray:
        """Torque of a cycle as `judge` finds it in a recording, shape (samples, n_axes)."""
        motion = self.detector.motion
        recording = Recording(
            source="a cycle of the study",
            robot=self.detector.robot,
            side="motor",
            sample_period=motion.sample_period,
            position=cycle[0],
            torque=cycle[2],
        )
        return find_cycles(recording, motion)[0]

    def recordings(self, robots: int, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draw sequences of healthy recordings.

        Args:
            robots: Number of sequences.
            count: Recordings in each of them.
            rng: Source of randomness.

        Returns:
            Their numbers in the pool, shape (robots, count); none twice in a sequence.
        """
        return np.stack([rng.choice(len(self.pool), count, replace=False) for _ in range(robots)])

    def alarms(self, scores: np.ndarray) -> np.ndarray:
        """Tell after the last recording of sequences whether there is an alarm.

        Args:
            scores: Shape (robots, recordings, columns).

        Returns:
            Shape (robots,). Friction of all axes as at another temperature is none.
        """
        return np.asarray(self._statistic(scores) > self.detector.posterior.limit_)

    def _statistic(self, scores: np.ndarray) -> np.ndarray:
        """Statistic of each sequence; -inf if it shows another temperature."""
        posterior = self.detector.posterior
        statistic, odds = posterior.strongest(scores)
        warmer = np.array([cause.label == TEMPERATURE for cause in posterior.effects.causes])
        return np.where(warmer[np.argmax(odds, axis=1)], -np.inf, statistic)

    def days(self, shift: np.ndarray | float, numbers: np.ndarray) -> np.ndarray:
        """Tell on which days there is an alarm after any of the day's recordings.

        Args:
            shift: Change of the scores on the day.
            numbers: Of the recordings before the day and on it, from `recordings`.

        Returns:
            Shape (days,).
        """
        raised = np.zeros(len(numbers), bool)
        before = numbers.shape[1] - LOGGED
        for last in range(LOGGED, 0, -1):  # the last recording of a day tells most often
            scores = self.pool[numbers[~raised, : before + last]]
            scores[:, before:] += shift
            raised[~raised] = self.alarms(scores)
            if raised.all():
                break
        return raised

    def delays(self, shift: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """Count the recordings until an alarm, of an effect that is there from the first one on.

        Args:
            shift: Change of the scores.
            numbers: Of the recordings, from `recordings`.

        Returns:
            Shape (robots,); infinite where there is no alarm.
        """
        found = np.full(len(numbers), np.inf)
        before = 0
        for count in lengths_of(numbers.shape[1], _TIMES):
            late = np.flatnonzero(np.isinf(found))
            if not len(late):
                break
            now = late[self.alarms(self.pool[numbers[late, :count]] + shift)]
            found[now] = count
            for fewer in range(count - 1, before, -1):
                now = now[self.alarms(self.pool[numbers[now, :fewer]] + shift)] if len(now) else now
                found[now] = fewer
            before = count
        return found

    def limit(
        self,
        effect: Effect,
        axis: int,
        bench: Bench,
        *,
        first: float,
        days: int,
        rng: np.random.Generator,
    ) -> dict[str, Any]:
        """Find the smallest severity that raises an alarm on enough days, and what it is called.

        Args:
            effect: The effect.
            axis: Axis, from 1.
            bench: The robot at its task.
            first: Severity from which on it is looked for, in the unit of the effect.
            days: Number of days for each severity.
            rng: Source of randomness.

        Returns:
            Entries for JSON: `severity` (None if no severity is seen), `largest` severity that was
            tried, `delays`, and what alarms are called `at_limit` and `at_default` severity: on
            how many days there is an alarm at the end (`alarms`, a share), on which share of them
            effect and axis are right (`named`) or the axis is (`axis_named`), and the most
            frequent wrong answer (`called`).
        """
        numbers = self.recordings(days, BEFORE + LOGGED, rng)
        shifts: dict[float, np.ndarray | None] = {}

        def seen(severity: float) -> bool:
            shift = shifts[severity] = self._of(effect, axis, bench, severity)
            return shift is not None and bool(self.days(shift, numbers).mean() >= DETECTED)

        levels = [first * _RATIO**k for k in range(_LEVELS)]
        levels = [*(s for s in levels if s < effect.largest), min(levels[-1], effect.largest)]
        high = next((severity for severity in levels if seen(severity)), None)
        if high is not None:
            low = max((s for s in shifts if s < high), default=high / _RATIO)
            for _ in range(_HALVINGS):
                middle = float(np.sqrt(low * high))
                low, high = (low, middle) if seen(middle) else (middle, high)
        possible = [s for s, shift in shifts.items() if shift is not None]
        told: dict[str, Any] = {"severity": high, "largest": max(possible, default=0.0)}
        usual = self._of(effect, axis, bench, effect.default)
        told["at_default"] = self._names(effect.name, axis, usual, numbers)
        limit = None if high is None else shifts[high]
        told["at_limit"] = self._names(effect.name, axis, limit, numbers)
        asked = {"default": effect.default}
        asked |= {f"{m:g} x limit": m * high for m in MULTIPLES if high is not None}
        months = self.recordings(_ROBOTS, LONGEST, rng)
        told["delays"] = {
            name: self._delay(self._of(effect, axis, bench, one), months)
            for name, one in asked.items()
        }
        return told

    def _of(self, effect: Effect, axis: int, bench: Bench, severity: float) -> np.ndarray | None:
        cycle = bench.worn(effect, axis, severity)
        return None if cycle is None else self.shift(cycle)

    def _delay(self, shift: np.ndarray | None, months: np.ndarray) -> list[float | None] | None:
        """Quantiles 0.1, 0.5 and 0.9 of the time to detection [recordings]; None: not seen."""
        if shift is None:
            return None
        found = np.sort(self.delays(shift, months))
        quantiles = [float(found[int(q * len(found))]) for q in (0.1, 0.5, 0.9)]
        return [x if np.isfinite(x) else None for x in quantiles]

    def _names(
        self, effect: str, axis: int, shift: np.ndarray | None, numbers: np.ndarray
    ) -> dict[str, Any] | None:
        if shift is None:
            return None
        scores = self.pool[numbers]
        scores[:, -LOGGED:] += shift
        return self.names(effect, axis, scores)

    def names(self, effect: str, axis: int, scores: np.ndarray) -> dict[str, Any]:
        """Tell what alarms at the end of days are called.

        Args:
            effect: Name of the true effect.
            axis: Its axis, from 1.
            scores: As for `tops`.

        Returns:
            Entries for JSON, which `limit` lists.
        """
        answers = [self.detector.judge(one) for one in scores]
        answers = [one for one in answers if one["alarm"]]
        right = [(one["effect"], one["axes"]) == (effect, [axis]) for one in answers]
        where = [one["axes"] == [axis] for one in answers]
        wrong = Counter(
            f"{one['effect'] or one['verdict']} {'+'.join(map(str, one['axes']))}"
            for one, correct in zip(answers, right, strict=True)
            if not correct
        )
        count = max(len(answers), 1)
        return {
            "alarms": len(answers) / len(scores),
            "named": sum(right) / count,
            "axis_named": sum(where) / count,
            "called": wrong.most_common(1)[0][0] if wrong else None,
        }
