"""Runs the command line on a small disk that is full, and again when the disk has space.

    unshare --map-root-user --mount --user python full_disk.py DISK SIZES -- ARGUMENTS

For each size in kilobytes, such as 40,80, a memory file system of that size is mounted on DISK. One
line of JSON is printed for each size. A size of 0 stands for a disk that another process fills and
frees all the time.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from driver import command, sums


def main() -> None:
    """See the docstring of the module."""
    disk, sizes = Path(sys.argv[1]), [int(size) for size in sys.argv[2].split(",")]
    arguments = sys.argv[4:]
    for size in sizes:
        mount = ["mount", "-t", "tmpfs", "-o", f"size={size or 400}k", "tmpfs", str(disk)]
        subprocess.run(mount, check=True)
        filler = 0 if size else _fill_and_free(disk)
        log = disk.with_name(f"{disk.name}{size}")
        status = command(arguments, disk / "out", (0, 0, 0, ""), log)
        told = {"size": size, "status": status, "sums": sums(disk / "out")}
        told["out"], told["err"] = (Path(f"{log}.{k}").read_text() for k in (1, 2))
        if filler:
            os.kill(filler, signal.SIGKILL)
            os.waitpid(filler, 0)
        subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True)
        told["again"] = command(arguments, disk / "out", (0, 0, 0, ""), log)
        told["sums_again"] = sums(disk / "out")
        print(json.dumps(told), flush=True)
        subprocess.run(["umount", str(disk)], check=True)


def _fill_and_free(disk: Path) -> int:
    """Start a process that fills the disk and frees it, over and over; its process id."""
    child = os.fork()
    if child:
        return child
    path = disk / "filler"
    while True:
        try:
            with path.open("ab") as file:
                file.write(bytes(4096))
        except OSError:
            path.unlink(missing_ok=True)
            time.sleep(0.01)


if __name__ == "__main__":
    main()
