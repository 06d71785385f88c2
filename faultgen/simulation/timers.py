"""Stepping without MuJoCo's profiler.

MuJoCo's Python package lets every step read the clock many times, for timings that nobody here
looks at. They take about an eighth of a step of our models, and change no result.
`mujoco.set_mjcb_time(None)` does not stop them, because it leaves the clock of the package in
place. So the pointer to the clock is cleared in the library itself, where MuJoCo's manual allows it
to be empty.
"""

from __future__ import annotations

import ctypes
from pathlib import Path

import mujoco


def stop_timers() -> bool:
    """Stop the timings of this process.

    Returns:
        Whether the library was found. If not, steps take longer, with the same results.
    """
    for path in sorted(Path(mujoco.__file__).parent.glob("*mujoco.*")):
        if path.suffix in (".dll", ".dylib") or ".so" in path.name:
            try:
                clock = ctypes.c_void_p.in_dll(ctypes.CDLL(str(path)), "mjcb_time")
            except (OSError, ValueError):
                continue
            clock.value = None
            return True
    return False
