"""Many laboratories: recordings of an independent simulator, drawn from factors.

docs/results/discovery.md describes them; `benchmarks/score_discovery.py` scores them.
"""
