"""The study of the thesis' chapter 6: isolation."""
