"""Many laboratories: recordings of an independent simulator, drawn from factors.

docs/laboratories.md describes them; `benchmarks/score_discovery.py` runs and scores them.
"""
