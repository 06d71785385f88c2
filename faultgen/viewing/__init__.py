"""Looking at robots: a window, films and pictures of a robot that does its task."""
