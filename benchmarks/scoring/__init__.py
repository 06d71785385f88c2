"""Scores of `faultgen discover` on robots of other simulators, on own data and on real machines.

`benchmarks/discovery/score.py` is the command; docs/results/discovery.md says what is counted.
"""
