"""Measured data of robots: reading, importing, resampling, joining, checks and noise.

Nothing here needs a replay of the model, and nothing here imports discovery.
"""
