"""What a machine has: versions of software, cores, memory, disk, and whether there is a GPU."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from packaging.requirements import Requirement


@dataclass(frozen=True)
class Package:
    """An installed package that faultgen needs."""

    name: str
    """Its name."""
    version: str | None
    """Its version; None if it is not installed."""
    needed: str
    """Versions that are allowed, such as ">=2.0"; may be empty."""

    @property
    def fit(self) -> bool:
        """Whether the installed version is allowed."""
        if self.version is None:
            return False
        return Requirement(f"{self.name}{self.needed}").specifier.contains(
            self.version, prereleases=True
        )


def packages(name: str = "faultgen") -> list[Package]:
    """List the packages that an installed package needs, without those of its extras.

    Args:
        name: The package.
    """
    found = []
    for line in requires(name) or []:
        need = Requirement(line)
        if need.marker is None or need.marker.evaluate({"extra": ""}):
            found.append(Package(need.name, installed(need.name), str(need.specifier)))
    return found


def installed(name: str) -> str | None:
    """Return the version of an installed package; None if it is not installed.

    Args:
        name: The package.
    """
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def python_version() -> str:
    """Return the version of Python and of the operating system, in words."""
    return f"{platform.python_version()} on {platform.system()} {platform.machine()}"


def memory() -> float | None:
    """Return the size of the memory [GiB]; None if the system does not tell it."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    except (AttributeError, ValueError, OSError):
        return None


def free_disk(folder: Path) -> float:
    """Return the free space of a disk [GiB].

    Args:
        folder: A folder on it.
    """
    return shutil.disk_usage(folder).free / 2**30


def gpu() -> str | None:
    """Return the names of NVIDIA GPUs; None if there is none, or no driver that tells."""
    program = shutil.which("nvidia-smi")
    if program is None:
        return None
    command = [program, "--query-gpu=name", "--format=csv,noheader"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=20)
    except (OSError, subprocess.TimeoutExpired):
        return None
    names = [line.strip() for line in done.stdout.splitlines() if line.strip()]
    return ", ".join(names) if done.returncode == 0 and names else None


def python_is_fit(oldest: tuple[int, int]) -> bool:
    """Say whether the running Python is new enough.

    Args:
        oldest: Oldest version that is allowed.
    """
    return sys.version_info[:2] >= oldest
