"""The condition of a run's robot in each cycle: temperature, payload and faults."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from faultgen.applied import Applied
from faultgen.dataset.instance import Instance
from faultgen.dataset.planning import Run
from faultgen.dataset.run_file import growth_of
from faultgen.monitoring.environment import Surroundings
from faultgen.robot import Robot
from faultgen.simulation.plant import Plant
from faultgen.simulation.state import Condition, plant_at


@dataclass(frozen=True, eq=False)
class Course:
    """What changes from cycle to cycle of a run."""

    run: Run
    """The run."""
    around: Surroundings
    """Temperature and payload in each cycle."""
    healthy: Sequence[tuple[Applied, ...]]
    """How the healthy robot differs in each cycle."""
    instance: Instance | None = None
    """How the robot of this run differs from its model."""

    def __iter__(self) -> Iterator[Condition]:
        """Yield the condition of each cycle."""
        for severity, temperature, load, own in zip(
            growth_of(self.run).tolist(),
            self.around.temperature.tolist(),
            self.around.payload_factor.tolist(),
            self.healthy,
            strict=True,
        ):
            yield Condition(temperature, load, (*own, *faults_at(self.run, severity)))

    def plants(self, robot: Robot) -> Iterator[Plant]:
        """Yield the robot as it is in each cycle; it is assembled anew where something changed.

        Args:
            robot: The healthy robot.

        Yields:
            The plant of each cycle.
        """
        spec = robot.spec() if self.instance is None else self.instance.edit(robot.spec())
        before: Condition | None = None
        plant = Plant(robot.model)  # replaced in the first cycle
        for now in self:
            if now != before:
                plant = plant_at(robot, spec, now)
                before = now
            yield plant


def faults_at(run: Run, severity: float) -> tuple[Applied, ...]:
    """Return the faults of a run when its main effect has come to a severity.

    Args:
        run: The run.
        severity: Severity of the main effect, in its unit. The further effects have come as far, as
            a share of their final severities.

    Returns:
        The faults, the main effect first.
    """
    share = severity / run.severity if run.severity else severity
    return (
        *(replace(one, severity=severity) for one in run.own_faults),
        *(replace(one, severity=one.severity * share) for one in run.beside),
    )
