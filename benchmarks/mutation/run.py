"""Mutation run: how many small errors, put into the code on purpose, do the tests notice?

    python -m benchmarks.mutation.run [MODULE ...] [--mutants N] [--workers N]
        [--save FILE] [--again]

In a copy of the repository, the run changes one place of a module at a time and runs the tests that
concern this module. A mutant is killed if a test fails or does not end. It survives if all of them
pass. `mutation.toml` beside this file names the modules, their tests and the number of mutants. The
mutants are drawn at random with a fixed seed, so the same code gives the same mutants.

The run prints the score of each module and its surviving mutants. With --save it also puts the
result of a module into that JSON file as soon as it has it, and keeps those of other modules there.
The score of the first run of a module stays in the file. With --again, only the mutants that
survived according to the file are tried, for example after a test for them was added.
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
from mutation.mutants import draw_mutants
from mutation.trials import preload, tests_by_line, try_mutants

ROOT = Path(__file__).parents[2]


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
    module: str,
    tests: list[str],
    number: int,
    seed: int,
    folders: list[Path],
    before: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Result of one module.

    Args:
        module: Path of the module in the repository.
        tests: Arguments of pytest, which choose the tests.
        number: How many mutants to draw.
        seed: Decides which, together with the name of the module.
        folders: Copies of the repository, one for each mutant that is tried at the same time.
        before: Earlier result, of which only the survivors are tried again.

    Raises:
        RuntimeError: A test fails without any change, or the earlier result is of other mutants.
    """
    start = time.perf_counter()
    source = (folders[0] / module).read_text()
    digest = hashlib.sha256(source.encode()).hexdigest()
    if before and (before["source_sha256"], before["seed"]) != (digest, seed):
        raise RuntimeError("has changed since its mutants were tried; try it without --again")
    # of seed and name, so that a module's mutants do not depend on the other modules
    name = int.from_bytes(hashlib.sha256(module.encode()).digest()[:8])
    drawn = before["mutants"] if before else number
    mutants = draw_mutants(source, drawn, np.random.default_rng([seed, name]))
    outcomes: list[dict[str, Any]] = before["outcomes"] if before else [{} for _ in mutants]
    chosen = [k for k, one in enumerate(outcomes) if one.get("outcome", "survived") == "survived"]
    told = tests_by_line(folders[0], module, tests)
    tried = try_mutants(module, tests, [mutants[k] for k in chosen], told, folders)
    for k, outcome in zip(chosen, tried, strict=True):
        outcomes[k] = outcome
    counts = Counter(one["outcome"] for one in outcomes)
    return {
        "tests": tests,
        "source_sha256": digest,
        "seed": seed,
        "mutants": len(outcomes),
        "killed": counts["killed"] + counts["hung"],
        "hung": counts["hung"],
        "tests_seconds": round(told.seconds, 1),
        "seconds": round(time.perf_counter() - start, 1),
        "machine": {"processors": os.cpu_count(), "python": platform.python_version()},
        "outcomes": outcomes,
    }


def read(path: Path | None) -> dict[str, Any]:
    """Read the results of all modules that are in a file; none if there is no file."""
    return json.loads(path.read_text()) if path and path.is_file() else {}


def put(path: Path, module: str, result: dict[str, Any]) -> None:
    """Write the result of one module into the file.

    Args:
        path: The file.
        module: Name of the module.
        result: Result of the module. If it is the first one, its score is kept as `first_run`.
    """
    results = read(path)
    score = {name: result[name] for name in ("mutants", "killed")}
    first = results[module].get("first_run") if module in results else score
    results[module] = result | ({"first_run": first} if first else {})
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(dict(sorted(results.items())), indent=1) + "\n")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("modules", nargs="*", metavar="MODULE", help="Default: all of them.")
    parser.add_argument("--mutants", type=int, help="Mutants of each module.")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--save", type=Path, help="JSON file to put the results into.")
    parser.add_argument("--again", action="store_true", help="Try the survivors in that file only.")
    arguments = parser.parse_args()
    config = tomllib.loads((Path(__file__).parent / "mutation.toml").read_text())
    seed, number = config.pop("seed"), config.pop("mutants")
    known: dict[str, dict[str, Any]] = {
        module: {"group": group, "tests": [f"tests/{name}" for name in tests]}
        for group, modules in config.items()
        for module, tests in modules.items()
    }
    if unknown := set(arguments.modules) - set(known):
        parser.error(f"not in mutation.toml: {', '.join(sorted(unknown))}")
    earlier = read(arguments.save) if arguments.again else {}
    if arguments.again and (new := set(arguments.modules) - set(earlier)):
        parser.error(f"not in the file of --save: {', '.join(sorted(new))}")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends the tests that still run
    preload()
    with tempfile.TemporaryDirectory() as parent:
        folders = [copy_of_repository(Path(parent, str(k))) for k in range(arguments.workers)]
        for module in arguments.modules or (sorted(earlier) if arguments.again else known):
            tests, chosen = known[module]["tests"], arguments.mutants or number
            try:
                found = try_module(module, tests, chosen, seed, folders, earlier.get(module))
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
