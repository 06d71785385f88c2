"""Forecasts of `faultgen monitor` on runs to failure that `faultgen generate` made.

    python -m benchmarks.monitoring.monitor_lives DETECTOR DATASET... --limit 0.3 --out FILE

Each cycle of a run counts as the recording of a day. At 50, 65, 80 and 95 % of the time until the
limit, the robot is judged with all recordings so far, and the time that is left is forecast as
`monitor` does. Runs without an alarm by then, or with another name, are counted and left out.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from faultgen.analysis import forecast_severity, phm_score

from faultgen.dataset.reader import open_dataset
from faultgen.system.files import write_text
from faultgen.twin.detector import Detector, load_detector
from faultgen.twin.naming import scale_of

SHARES = (0.5, 0.65, 0.8, 0.95)
QUANTILES = (0.1, 0.5, 0.9)


def forecasts(
    detector: Detector, dataset: Path, limit: float, rng: np.random.Generator
) -> list[dict[str, Any]]:
    """Forecast each run at each share of its life.

    Args:
        detector: The detector.
        dataset: Runs of its robot and program.
        limit: Severity that ends a life.
        rng: Source of randomness.
    """
    rows = []
    for run in open_dataset(dataset).runs:
        axes = [int(axis) for axis in run["axes"]]
        severity = run.read("cycle/severity")
        if not axes or severity.max() < limit:
            continue
        end = int(np.argmax(severity >= limit))
        torque = np.asarray(run.read("signals/motor_torque"), float)
        scores = np.array([detector.scores([cycle]) for cycle in torque])
        for share in SHARES:
            count = round(share * end)
            answer = detector.judge(scores[:count])
            row = {"share": share, "true": end - (count - 1), "alarm": answer["alarm"]}
            row["right"] = (answer["effect"], answer["axes"]) == (str(run["effect"]), axes)
            rows.append(row)
            if not row["right"]:
                continue
            effect = answer["effect"]
            found = detector.severities(scores[:count], effect, axes)
            errors = np.maximum((found[:, 2] - found[:, 0]) / 3.92, 1e-9)
            for name, scale in (("own model", 0.0), ("as monitor", scale_of(effect))):
                told = forecast_severity(
                    np.arange(float(count)),
                    found[:, 1],
                    errors,
                    limit=limit,
                    rng=rng,
                    scale_error=scale,
                )
                row[name] = [told.remaining(q) for q in QUANTILES]
    return rows


def summary(rows: list[dict[str, Any]], name: str) -> dict[str, Any]:
    """Coverage of the intervals of 80 %, their width, and errors of the median.

    Args:
        rows: From `forecasts`.
        name: Which forecast.
    """
    own = [row for row in rows if name in row]
    true = np.array([row["true"] for row in own], float)
    low, middle, high = np.array([row[name] for row in own]).T
    ends = np.isfinite(middle)
    return {
        "forecasts": len(own),
        "coverage of 80 % intervals": float(np.mean((low <= true) & (true <= high))),
        "median error over the true time": float(np.median(np.abs(middle - true) / true)),
        "median early end over the true time": float(np.median(low / true)),
        "median late end over the true time": float(np.median(high / true)),
        "RMSE [recordings]": float(np.sqrt(np.mean((middle - true)[ends] ** 2))),
        "score of PHM 2008 per forecast": phm_score(middle[ends], true[ends]) / int(ends.sum()),
        "forecasts without an end": int((~ends).sum()),
    }


def main(
    detector: Annotated[Path, typer.Argument(help="Folder of a detector.")],
    datasets: Annotated[list[Path], typer.Argument(help="Runs whose wear passes the limit.")],
    limit: Annotated[float, typer.Option(help="Severity that ends a life.")] = 0.3,
    out: Annotated[Path | None, typer.Option(help="File for the result (JSON).")] = None,
) -> None:
    """Measure, and print the result."""
    known, rng = load_detector(detector), np.random.default_rng(0)
    rows = [row for path in datasets for row in forecasts(known, path, limit, rng)]
    result: dict[str, Any] = {"limit": limit}
    for share in SHARES:
        own = [row for row in rows if row["share"] == share]
        result[f"{share:.0%} of the life"] = {
            "runs": len(own),
            "alarm": sum(row["alarm"] for row in own),
            "right name": sum(row["right"] for row in own),
        } | {
            name: summary(own, name)
            for name in ("own model", "as monitor")
            if any(name in row for row in own)
        }
    text = json.dumps(result, indent=1)
    print(text)
    if out is not None:
        write_text(out, text + "\n")


if __name__ == "__main__":
    typer.run(main)
