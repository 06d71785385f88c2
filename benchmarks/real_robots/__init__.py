"""Recordings and known numbers of real robots."""
