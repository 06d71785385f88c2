"""Access to the operating system: safe files, parallel processes, and reading of users' files."""
