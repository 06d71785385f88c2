"""Studies: where generated data meets the methods of `analysis`."""
