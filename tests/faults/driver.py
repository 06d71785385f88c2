"""Runs the command line again and again, each time with another failing system call.

    LD_PRELOAD=shim.so python driver.py FOLDER KIND ERROR START STEP [PREPARED] -- ARGUMENTS

For each number START, START + STEP, ... the command runs in a child process, in a folder of its own
in FOLDER, with the number-th call of that kind failing. It runs a second time without a fault. One
line of JSON is printed for each number; the first number for which no call was left ends the loop.
The folder begins as a copy of PREPARED, and replaces the word HERE in the arguments; without
it, "-o" and the folder are added to them.
"""

import ctypes
import json
import os
import shutil
import sys
import traceback
from pathlib import Path

import scipy.signal
import scipy.stats  # noqa: F401

import faultgen.cli
import faultgen.dataset.merge
import faultgen.dataset.sweep

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
    number = int(start)
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
        number += int(step)


def sums(folder: Path) -> dict[str, str]:
    """Checksums of the files in a folder, by name."""
    from faultgen.system.files import file_sha256

    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != ".lock"]
    return {str(path.relative_to(folder)): file_sha256(path) for path in files}


if __name__ == "__main__":
    main()
