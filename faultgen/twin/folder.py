"""Names of the files that a twin's folder has beside the robot's."""

RESULT = "twin.json"
"""The numbers of the twin."""

HEALTHY = "healthy.h5"
"""Mean cycle of each healthy recording: torque of the motors, shape (recordings, samples, n_axes),
in [N m]; nan where nothing was recorded."""

TASK = "recorded"
"""Name of the recorded motion among the tasks of the robot's folder."""
