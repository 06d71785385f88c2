"""The study of the thesis' chapter 3: detection."""
