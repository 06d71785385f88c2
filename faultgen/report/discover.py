"""Discovery from files to files: the result, the model, the next experiment and the report.

result = discover("measured.h5", "puma560", healthy="healthy.h5", out="out")
result.verdict, result.effects[0]["sentence"], result["gap"]["after"]
"""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from faultgen.discovery.examine import examine
from faultgen.discovery.inputs import Options, check_positive
from faultgen.discovery.terms.candidates import check_names, names_by_use
from faultgen.effects import EFFECTS
from faultgen.errors import InputError
from faultgen.system.version import __version__

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class DiscoveryResult(dict[str, Any]):
    """The content of ``discovery.json``, with its main entries as attributes."""

    @property
    def verdict(self) -> str:
        """One of the six verdicts of docs/discovery.md."""
        return str(self["verdict"])

    @property
    def summary(self) -> str:
        """What was found, in one sentence."""
        return str(self["summary"])

    @property
    def effects(self) -> list[dict[str, Any]]:
        """The effects that were found, with `effect`, `axis`, `parameters` and `sentence`."""
        return list(self["effects"])

    def __repr__(self) -> str:
        return f"<Discovery: {self.verdict}. {self.summary}>"

    def _repr_html_(self) -> str:
        """The sentence and a table of the effects, which notebooks show."""
        from tabulate import tabulate

        head = ("effect", "axis", "what", "confidence")
        rows = [
            (e["effect"], e["axis"], e.get("sentence", ""), e["confidence"]) for e in self.effects
        ]
        table = tabulate(rows, head, "html", floatfmt=".2f") if rows else ""
        return f"<p><b>{escape(self.verdict)}</b>: {escape(self.summary)}</p>{table}"

    def to_dict(self) -> dict[str, Any]:
        """Return a plain dictionary, ready for JSON."""
        return dict(self)

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the torque error of each axis: as given, calibrated, with the effects, and noise.

        Args:
            axes: Where to draw. Default: a new figure.

        Returns:
            The axes.
        """
        from faultgen.analysis.plots import COLOURS

        if axes is None:
            import matplotlib.pyplot as plt

            axes = plt.figure().subplots()
        rows = self["gap"]["per_axis"]
        kinds = ("before", "calibrated", "after", "floor")
        for place, (kind, colour) in enumerate(zip(kinds, COLOURS, strict=False)):
            left = [row["axis"] + 0.2 * (place - 1.5) for row in rows]
            axes.bar(left, [100 * row[kind] for row in rows], 0.2, label=kind, color=colour)
        axes.set_xticks([row["axis"] for row in rows])
        axes.set(xlabel="Axis", ylabel="Torque error over RMS torque [%]", title=self.verdict)
        axes.legend(loc="upper right")
        return axes


def discover(
    measured: str | Path | Sequence[str | Path],
    robot: str | Path,
    healthy: str | Path | Sequence[str | Path] | None = None,
    validate: str | Path | None = None,
    *,
    out: str | Path | None = None,
    workers: int = 1,
    exclude: Collection[str] = (),
    include: Collection[str] = (),
    prior_scale: float | None = None,
    white_noise: bool = False,
    low_pass: float | None = None,
    trust_log: bool = False,
    cache: str | Path | None = None,
) -> DiscoveryResult:
    """Find the physical effect that a measured robot has and its model lacks.

    Args:
        measured: Recording of the robot, or several that are used together; docs/measured.md
            describes the format.
        robot: Name of the robot, or path of its MJCF file or folder.
        healthy: Recording of the same motions from before the change, or several of them in any
            order, equally many for each measured recording. Several runs also show how much the
            unchanged robot differs from run to run, and such differences are not reported. Without
            any, the model is first calibrated on the recording itself, and an effect is reported
            only if it is larger than the errors of this model.
        validate: Recording of other motions with the effect. It is used only to score the result.
        out: Folder for ``discovery.json``, ``report.html``, the folder ``model`` that is a robot
            with all that was found, its MJCF part ``model.xml`` and, if there is one, the next
            experiment. With None, no files are written.
        workers: Number of processes. The result does not depend on it.
        exclude: Names of effects that are not considered.
        include: Names of effects that are considered only on request, with the use
            "on request".
        prior_scale: How uncertain the model's parameters (`candidates.NUMBERS`) are, as a multiple
            of the default. None: it is learned from the recording, for each kind of parameter.
        white_noise: Whether long-lasting errors get full weight. Otherwise part of them is treated
            as drifting noise. Use it for recordings that were filtered; see `regression.plain`.
        low_pass: Cut-off frequency [Hz] of a low-pass filter for recordings without a reference
            position, in which the simulation follows the measured position. With None, they are
            not filtered.
        trust_log: Whether the recordings are taken as they are. Otherwise signs and units of the
            log that the recordings show to be wrong are corrected, and axes without a usable
            torque are left out; each is told in `findings`.
        cache: Folder that keeps simulated sensitivities, so that later calls with recordings of the
            same program, and with the same healthy recording, are faster.

    Returns:
        The content of ``discovery.json``.

    Raises:
        InputError: A recording or an option cannot be used, or `measured` and `healthy` are not
            recordings of the same motions.
        SimulationFailed: The model diverges on the recorded motion.
    """
    started = time.monotonic()
    check_names("include", include, names_by_use("on request"))
    check_names("exclude", exclude, EFFECTS)
    if prior_scale is not None:
        check_positive("prior-scale", prior_scale)
    for name, folder in (("out", out), ("cache", cache)):
        if folder is not None and Path(folder).is_file():
            raise InputError(f"{name}: must be a folder, not the file {folder}")
    options = Options(
        workers=workers,
        exclude=exclude,
        include=include,
        prior_scale=prior_scale,
        white_noise=white_noise,
        low_pass=low_pass,
        trust_log=trust_log,
        cache=cache,
    )
    result, found = examine(measured, robot, healthy, validate, options)
    result |= {"seconds": round(time.monotonic() - started, 1), "version": __version__}
    if out is not None:
        from faultgen.report.discovery_report import write_discovery

        write_discovery(Path(out), result, found)
    return DiscoveryResult(result)
