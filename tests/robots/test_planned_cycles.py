"""The table of planned cycles holds what planning gives, and is not used for anything else."""

import json

from conftest import faultgen_here

from faultgen import planned_cycles
from faultgen.planned_cycles import plan_cycle, planned_cycle
from faultgen.robot_names import robot_names
from faultgen.tasks import task_names


def test_the_table_is_what_planning_gives():
    """After a change of a robot, a task or the planning: python -m faultgen.planned_cycles."""
    for robot in robot_names():
        for task in task_names(robot):
            assert planned_cycle(robot, task) == plan_cycle(robot, task), (robot, task)


def test_other_robots_are_planned(tiny_robot_path):
    assert planned_cycle(tiny_robot_path, "pick_and_place") is None
    told = json.loads(faultgen_here("tasks", "--robot", "puma560", "--json").stdout)
    assert len(told) == len(task_names("puma560"))


def test_a_changed_task_is_planned_again(monkeypatch):
    """Its checksum is another one."""
    assert planned_cycle("puma560", "arc_weld") is not None
    text = planned_cycles.task_text
    monkeypatch.setattr(planned_cycles, "task_text", lambda *name: text(*name) + "\n# mine\n")
    assert planned_cycle("puma560", "arc_weld") is None
