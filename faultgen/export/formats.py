"""The formats into which `faultgen export` writes datasets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from faultgen.errors import InputError

DATASET_FORMATS = {
    "lerobot": "LeRobotDataset v3.0: episodes of states and actions",
    "huggingface": "folder for datasets.load_dataset and the Hugging Face Hub, with Croissant",
    "factorynet": "set points, effort, feedback and context, with the columns of FactoryNet",
    "mcap": "MCAP files, which Foxglove plays back",
    "rerun": "recordings of Rerun",
    "zarr": "Zarr store of format 3, which clouds and xarray read in pieces",
}
"""What each format is, by name."""

OPTIONS = {"episode": "lerobot", "side": "lerobot", "split": "huggingface"}
"""The format that uses each option, by name of the option."""


def export_dataset(sources: Sequence[Path], name: str, out: Path, **options: Any) -> dict[str, Any]:
    """Write runs in another format.

    Args:
        sources: The folder or the ``dataset.h5`` of one dataset, or any number of run files.
        name: A name of `DATASET_FORMATS`.
        out: The folder; for "mcap" and "rerun" also a file.
        **options: Values of `OPTIONS`; None stands for the default.

    Returns:
        What was written, for the message.

    Raises:
        InputError: The runs do not fit the format, an option does not, or a package is missing.
        StorageFailed: The folder or the file cannot be written.
    """
    from faultgen.export.cycles import Source
    from faultgen.export.places import check_new

    given = {option: value for option, value in options.items() if value is not None}
    for option in given:
        if OPTIONS[option] != name:
            raise InputError(f"--{option}: belongs to --format {OPTIONS[option]}, not to {name}")
    if "split" in given:
        given["by"] = given.pop("split")
    check_new(out)
    write = _writer(name)
    return write(Source.of(sources), out, **given)


def _writer(name: str) -> Callable[..., dict[str, Any]]:
    from faultgen.export.factorynet import write_factorynet
    from faultgen.export.huggingface import write_huggingface
    from faultgen.export.lerobot import write_lerobot
    from faultgen.export.mcap_file import write_mcap
    from faultgen.export.rerun_file import write_rerun
    from faultgen.export.zarr_store import write_zarr

    writers: dict[str, Callable[..., dict[str, Any]]] = {
        "lerobot": write_lerobot,
        "huggingface": write_huggingface,
        "factorynet": write_factorynet,
        "mcap": write_mcap,
        "rerun": write_rerun,
        "zarr": write_zarr,
    }
    return writers[name]
