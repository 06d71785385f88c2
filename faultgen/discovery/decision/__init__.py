"""Which effects are missing, how certain they are, and the verdict."""
