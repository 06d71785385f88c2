"""Study `detectability`: the smallest severity of every effect that can be detected."""
