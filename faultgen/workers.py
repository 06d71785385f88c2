"""How many processes a command may start."""

from faultgen.errors import InputError

MOST_WORKERS = 1024
"""Largest number of processes."""


def check_workers(workers: int) -> int:
    """The number of processes, if it is possible.

    Raises:
        InputError: It is below 1 or above `MOST_WORKERS`.
    """
    if workers < 1:
        raise InputError(f"workers: must be at least 1, not {workers}")
    if workers > MOST_WORKERS:
        raise InputError(f"workers: must be at most {MOST_WORKERS}, not {workers}")
    return workers
