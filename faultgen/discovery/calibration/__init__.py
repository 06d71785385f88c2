"""The model's own numbers, fitted to a recording."""
