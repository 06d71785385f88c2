"""Sealed blind cases: a simulator of its own, robots that are off, effects in other forms.

Nothing in here is used by `faultgen`; see docs/results/discovery.md.
"""
