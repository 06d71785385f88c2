"""Scores of `faultgen discover` on robots of other simulators, on own data and on real machines.

`benchmarks/score_discovery.py` is the command; docs/score.md says what is counted.
"""
