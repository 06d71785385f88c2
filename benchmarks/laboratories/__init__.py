"""Many laboratories: recordings of an independent simulator, drawn from factors.

docs/results/discovery.md describes them; `benchmarks/discovery/score.py` scores them.
"""
