"""Robots in the formats of other programs: plain MJCF, URDF, and tables of the joints."""
