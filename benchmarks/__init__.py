"""Measurements behind the documentation; README.md lists them.

    python -m benchmarks.speed.growth     # in the folder of the repository

The scripts import one another by the names of their folders, as tests do that use them.
"""

import sys
from pathlib import Path

_HERE = Path(__file__).parent
sys.path[:0] = [str(_HERE), str(_HERE.parent / "tests")]
