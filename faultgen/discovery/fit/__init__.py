"""Residuals as regression problems, and fits of sets of terms to them."""
