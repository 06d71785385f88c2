"""Many laboratories: recordings of an independent simulator, drawn from factors.

docs/laboratories.md describes them; `benchmarks/laboratories_score.py` runs and scores them.
"""
