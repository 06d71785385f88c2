"""Runs the command line again and again, each time with another failing system call.

    LD_PRELOAD=shim.so python driver.py FOLDER KIND ERROR START STEP [PREPARED] -- ARGUMENTS

For each number START, START + STEP, ... the command runs in a child process, in a folder of its own
in FOLDER, with the number-th call of that kind failing. It runs a second time without a fault. One
line of JSON is printed for each number; the first number for which no call was left ends the loop.
The folder begins as a copy of PREPARED, and replaces the word HERE in the arguments; without
it, "-o" and the folder are added to them. A STEP below 0 stands for that with which at most -STEP
calls fail, evenly spread over all that the command makes.
"""

import ctypes
import hashlib
import json
import os
import re
import shutil
import sys
import traceback
from pathlib import Path

import scipy.signal
import scipy.stats  # noqa: F401

import faultgen.cli
import faultgen.dataset.merge
import faultgen.dataset.sweep

if "HERE" in " ".join(sys.argv):  # loaded once, and not by each of many child processes
    import faultgen.report.discover
    import faultgen.twin.judge
    import faultgen.twin.make
    import faultgen.twin.train  # noqa: F401

KINDS = ["none", "open", "write", "sync", "rename", "close", "truncate"]


def command(arguments: list[str], folder: Path, arm: tuple[int, int, int, str], log: Path) -> int:
    """Run the command line in a child process, with a fault armed; its wait status."""
    child = os.fork()
    if child:
        return os.waitpid(child, 0)[1]
    status = 99
    try:
        for stream in (1, 2):
            handle = os.open(f"{log}.{stream}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(handle, stream)
        own = [one.replace("HERE", str(folder)) for one in arguments]
        sys.argv = ["faultgen", *own, *([] if own != arguments else ["-o", str(folder)])]
        shim = ctypes.CDLL(None)
        if arm[0]:
            shim.fault_arm(*arm[:3], os.fsencode(arm[3]))
        try:
            faultgen.cli.main()
        except SystemExit as leave:
            status = int(leave.code or 0)
        if arm[0]:
            Path(f"{log}.count").write_text(str(shim.fault_count()))
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def main() -> None:
    """See the docstring of the module."""
    end = sys.argv.index("--")
    where, kind, error, start, step, *prepared = sys.argv[1:end]
    arguments = sys.argv[end + 1 :]
    number, every = int(start), int(step)
    if every < 0:
        count = _count(Path(where), kind, prepared, arguments)
        every = max(1, -(-count // -every))
    while True:
        folder = Path(where) / f"{kind}{number}"
        log = Path(where) / f"{kind}{number}.log"
        if prepared:  # the same folder again, because reports name it
            folder = Path(where) / kind
            shutil.rmtree(folder, ignore_errors=True)
            shutil.copytree(prepared[0], folder)
        told = {"number": number, "folder": str(folder)}
        arm = (KINDS.index(kind), number, int(error), f"{folder}/")
        told["status"] = command(arguments, folder, arm, log)
        told["out"], told["err"] = (Path(f"{log}.{k}").read_text() for k in (1, 2))
        counted = Path(f"{log}.count")
        told["failed"] = not counted.is_file() or int(counted.read_text()) >= abs(number)
        told["sums"] = sums(folder)
        told["again"] = command(arguments, folder, (0, 0, 0, ""), log)
        told["sums_again"] = sums(folder)
        print(json.dumps(told), flush=True)
        if not told["failed"] or not counted.is_file():  # none left, or the process crashed
            break
        number += every


def _count(where: Path, kind: str, prepared: list[str], arguments: list[str]) -> int:
    """How many calls of a kind the command makes."""
    folder, log = where / kind, where / f"{kind}.log"
    if prepared:
        shutil.copytree(prepared[0], folder)
    command(arguments, folder, (KINDS.index(kind), 1 << 30, 0, f"{folder}/"), log)
    shutil.rmtree(folder)
    return int(Path(f"{log}.count").read_text())


def sums(folder: Path) -> dict[str, str]:
    """Checksums of the files in a folder, by name, without the locks.

    What differs from one run of a command to the next is left out: how long it took, and the
    checksum of a file that says so. Whether this checksum is right is compared instead.
    """
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {
        str(path.relative_to(folder)): hashlib.sha256(_steady(path)).hexdigest()
        for path in files
        if not path.name.endswith(".lock")
    }


def _steady(path: Path) -> bytes:
    content = re.sub(rb'("seconds": |The discovery took )[0-9.]+', b"", path.read_bytes())
    if path.name != "checksums.txt":
        return content
    lines = [line.split("  ", 1) for line in content.decode().splitlines()]
    right = [
        hashlib.sha256((path.parent / name).read_bytes()).hexdigest() == checksum
        for checksum, name in lines
    ]
    return repr([(name, ok) for (_, name), ok in zip(lines, right, strict=True)]).encode()


if __name__ == "__main__":
    main()
