"""Files, processes and reading of user's files: what every part needs of the operating system."""
