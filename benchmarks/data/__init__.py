"""Datasets: what is lost when something fails, and what decides the answers of the studies."""
