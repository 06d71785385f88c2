"""Detectors and forecasts of twins, on robots that faultgen does not know."""
