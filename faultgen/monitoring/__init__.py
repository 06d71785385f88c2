"""Sensors and reductions: what a monitoring system measures in a cycle, and what it stores."""
