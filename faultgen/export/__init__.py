"""Datasets in the formats of other programs, from which people train and which they look at."""
