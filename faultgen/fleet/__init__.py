"""Fleets: robots that work for weeks, of which some fail, as their monitoring sees them."""

from faultgen.fleet.data import Fleet, FleetRobot, open_fleet

__all__ = ["Fleet", "FleetRobot", "open_fleet"]
