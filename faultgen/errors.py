"""The errors that faultgen raises for its users."""


class InputError(ValueError):
    """What the user gave is wrong. The message is one line: what, where, what would be right."""


class SimulationFailed(RuntimeError):
    """A simulation diverged or was stopped by MuJoCo; the message says when and why."""


class StorageFailed(OSError):
    """A file could not be written, or does not hold what was written. The message is one line."""
