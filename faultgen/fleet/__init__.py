"""Fleets: robots that work for weeks, what their monitoring stores, and the true state behind it.

fleet = generate_fleet(load_fleet("fleet.toml"), "out")
fleet = open_fleet("out")
fleet.robots[0].torque_indicator
"""

from faultgen.fleet.data import Fleet, FleetRobot, open_fleet
from faultgen.fleet.generate import generate_fleet
from faultgen.fleet.plan import FleetPlan, load_fleet

__all__ = ["Fleet", "FleetPlan", "FleetRobot", "generate_fleet", "load_fleet", "open_fleet"]
