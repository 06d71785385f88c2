"""The study of the thesis' chapter 4: training data."""
