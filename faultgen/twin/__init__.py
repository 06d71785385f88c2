"""From healthy recordings of a robot to a detector for it.

`make` learns a twin from the recordings, `train` makes a detector out of generated data, and
`judge` applies it to new recordings.
"""
