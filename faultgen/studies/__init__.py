"""Studies: here generated data are analysed with the methods of `analysis`."""
