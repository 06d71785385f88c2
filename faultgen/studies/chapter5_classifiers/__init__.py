"""The study of the thesis' chapter 5: classifiers."""
