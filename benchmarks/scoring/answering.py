"""Answers of `faultgen discover --json`, in processes of their own; one that exists is kept.

answer(entry, Path("trial/answers"))
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from threading import Timer
from typing import Any

from scoring.judging import FAILED, REFUSED

import faultgen
from faultgen.system.files import write_text

LIMIT = 900.0
"""Time [s] after which an answer counts as failed: a good deal more than any case may take."""
_COMMAND = Path(sys.executable).with_name("faultgen")
_ONE = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def version() -> str:
    """Hash of the source text of the package, which names a frozen version."""
    root = Path(faultgen.__file__).parent
    total = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        total.update(f"{path.relative_to(root)}\n".encode() + path.read_bytes())
    return total.hexdigest()[:12]


def called(words: list[str], limit: float = LIMIT) -> dict[str, Any]:
    """Call the program with one thread of linear algebra.

    Args:
        words: Its arguments.
        limit: Time after which it is ended [s].

    Returns:
        `status` (exit status, negative if it was ended), `stdout`, `stderr` and
        `processor_seconds` of it and of its own processes, `seconds`.
    """
    started = time.monotonic()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        process = subprocess.Popen(
            [str(_COMMAND), *words], stdout=out, stderr=err, env=os.environ | _ONE
        )
        timer = Timer(limit, process.kill)
        timer.start()
        _, status, used = os.wait4(process.pid, 0)
        timer.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        err.seek(0)
        return {
            "status": process.returncode,
            "stdout": out.read().decode(),
            "stderr": err.read().decode(),
            "processor_seconds": round(used.ru_utime + used.ru_stime, 2),
            "seconds": round(time.monotonic() - started, 2),
        }


def _result(words: list[str], limit: float) -> dict[str, Any]:
    done = called(words, limit)
    times = {name: done[name] for name in ("processor_seconds", "seconds")}
    if done["status"] == 0:
        found: dict[str, Any] = json.loads(done["stdout"])
        return found | times
    lines = done["stderr"].strip().splitlines()
    told = lines[-1] if lines else f"no message; exit status {done['status']}"
    verdict = REFUSED if done["status"] == 2 else FAILED
    return {"verdict": verdict, "effects": [], "alternatives": [], "error": told} | times


def answer(entry: Mapping[str, Any], folder: Path, trial: Path, limit: float = LIMIT) -> None:
    """Answer a case, unless its answer exists.

    Args:
        entry: Of the case: `name`, `discover` (arguments of the command) and perhaps `calibrate`
            (arguments of a calibration before it, whose result is the robot).
        folder: Where the answer goes, as <name>.json.
        trial: Folder to which paths in the arguments are relative.
        limit: Time that it may take [s].
    """
    target = folder / f"{entry['name']}.json"
    if target.is_file():
        return
    with tempfile.TemporaryDirectory() as scratch:
        words = [_placed(word, trial) for word in entry["discover"]]
        spent, result = 0.0, None
        if entry.get("calibrate"):
            model = f"{scratch}/calibrated"
            before = [_placed(word, trial) for word in entry["calibrate"]]
            done = _result(["calibrate", *before, "-o", model, "--workers", "1", "--json"], limit)
            spent = done["processor_seconds"]
            result = done if done.get("verdict") in (REFUSED, FAILED) else None
            words += ["--robot", model]
        if result is None:
            out = ["-o", f"{scratch}/out", "--workers", "1", "--json"]
            result = _result(["discover", *words, *out], limit)
            result["processor_seconds"] = round(result["processor_seconds"] + spent, 2)
    folder.mkdir(parents=True, exist_ok=True)
    write_text(target, json.dumps(result, indent=1, default=float) + "\n")


def _placed(word: str, trial: Path) -> str:
    """An argument; one that begins with './' is a path in the trial's folder."""
    return str(trial.resolve() / word[2:]) if word.startswith("./") else word
