"""The study of the thesis' chapter 2: events."""
