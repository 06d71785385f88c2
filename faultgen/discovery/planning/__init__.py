"""Which motions tell most about the effects."""
