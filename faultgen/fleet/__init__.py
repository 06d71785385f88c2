"""Fleets: robots that work for weeks, of which some fail, as their monitoring sees them."""
