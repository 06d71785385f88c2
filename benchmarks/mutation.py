"""Mutation run: how many small errors, put into the code on purpose, do the tests notice?

    python benchmarks/mutation.py [MODULE ...] [--mutants N] [--workers N] [--save FILE]

In a copy of the repository, the run changes one place of a module at a time and runs the tests that
concern this module. A mutant is killed if a test fails or does not end. It survives if all of them
pass. `mutation.toml` beside this file names the modules, their tests and the number of mutants. The
mutants are drawn at random with a fixed seed, so the same code gives the same mutants.

The run prints the score of each module and its surviving mutants. With --save it also puts the
result of a module into that JSON file as soon as it has it, and keeps those of other modules there.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from mutants import draw_mutants
from trials import preload, tests_by_line, try_mutants

ROOT = Path(__file__).parents[1]


def copy_of_repository(folder: Path) -> Path:
    """Copy every file that git knows or would add; changes that are not committed come along."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    for name in listed.stdout.splitlines():
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, folder / name)
    for part in ("analysis", "robots"):  # the copy is not installed, and they belong to the package
        (folder / "faultgen" / part).symlink_to(folder / part)
    return folder


def try_module(
    module: str, tests: list[str], number: int, seed: int, folders: list[Path]
) -> dict[str, Any]:
    """Result of one module.

    Args:
        module: Path of the module in the repository.
        tests: Names of its test files.
        number: How many mutants to draw.
        seed: Decides which, together with the name of the module.
        folders: Copies of the repository, one for each mutant that is tried at the same time.
    """
    start = time.perf_counter()
    source = (folders[0] / module).read_text()
    # of seed and name, so that a module's mutants do not depend on the other modules
    name = int.from_bytes(hashlib.sha256(module.encode()).digest()[:8])
    mutants = draw_mutants(source, number, np.random.default_rng([seed, name]))
    told = tests_by_line(folders[0], module, tests)
    outcomes = try_mutants(module, tests, mutants, told, folders)
    counts = Counter(one["outcome"] for one in outcomes)
    return {
        "tests": tests,
        "source_sha256": hashlib.sha256(source.encode()).hexdigest(),
        "seed": seed,
        "mutants": len(outcomes),
        "killed": counts["killed"] + counts["hung"],
        "hung": counts["hung"],
        "tests_seconds": round(told.seconds, 1),
        "seconds": round(time.perf_counter() - start, 1),
        "machine": {"processors": os.cpu_count(), "python": platform.python_version()},
        "outcomes": outcomes,
    }


def put(path: Path, module: str, result: dict[str, Any]) -> None:
    """Write the result of one module into the file.

    Args:
        path: The file.
        module: Name of the module.
        result: Result of the module.
    """
    results = json.loads(path.read_text()) if path.is_file() else {}
    results[module] = result
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(dict(sorted(results.items())), indent=1) + "\n")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("modules", nargs="*", metavar="MODULE", help="Default: all of them.")
    parser.add_argument("--mutants", type=int, help="Mutants of each module.")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--save", type=Path, help="JSON file to put the results into.")
    arguments = parser.parse_args()
    config = tomllib.loads((Path(__file__).parent / "mutation.toml").read_text())
    seed, number = config.pop("seed"), config.pop("mutants")
    known = {
        module: {"group": group, "tests": tests}
        for group, modules in config.items()
        for module, tests in modules.items()
    }
    if unknown := set(arguments.modules) - set(known):
        parser.error(f"not in mutation.toml: {', '.join(sorted(unknown))}")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends the tests that still run
    preload()
    with tempfile.TemporaryDirectory() as parent:
        folders = [copy_of_repository(Path(parent, str(k))) for k in range(arguments.workers)]
        for module in arguments.modules or known:
            chosen = arguments.mutants or number
            try:
                found = try_module(module, known[module]["tests"], chosen, seed, folders)
            except RuntimeError as error:
                sys.exit(f"{module}: {error}")
            print(f"{found['killed']:3d} of {found['mutants']:3d} killed  {module}", flush=True)
            for one in found["outcomes"]:
                if one["outcome"] == "survived":
                    print(f"    {one['line']}: {one['before']}  ->  {one['after']}", flush=True)
            if arguments.save:
                put(arguments.save, module, {"group": known[module]["group"], **found})


if __name__ == "__main__":
    main()
