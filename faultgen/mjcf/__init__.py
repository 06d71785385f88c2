"""MJCF files of robots: the checks that they must pass, and how they are compiled safely."""
