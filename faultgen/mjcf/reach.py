"""Which files a model may use: those in its own folder, in its package, and where the user allows.

A model names its meshes, textures and included files itself, and their content goes into robots
and datasets. A model of somebody else must therefore not name other files of the user.

    reach = Reach.of(Path("pkg/urdf/arm.urdf"))
    reach.check(Path("pkg/meshes/link.stl"), "robot file arm.urdf: mesh")
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from faultgen.errors import InputError

PACKAGE = "package.xml"
"""File in the folder of a ROS package."""

_ABOVE = 4  # folders above a model in which its package is looked for


@dataclass(frozen=True)
class Reach:
    """The folders whose files a model may use."""

    model: Path
    """File of the model."""
    folders: tuple[Path, ...]
    """The folders, without symbolic links. The first one is the model's own."""

    @classmethod
    def of(cls, model: Path, named: Sequence[Path] = ()) -> Reach:
        """Find the folders whose files a model may use.

        Args:
            model: File of the model.
            named: Further folders, which the user names.

        Returns:
            The model's own folder, its package (the closest folder above it with a ``package.xml``)
            and the folders that the user names. For a model that is a symbolic link, also the
            folder and the package of the file to which it leads.

        Raises:
            InputError: One of the folders that the user names does not exist.
        """
        for folder in named:
            if not folder.is_dir():
                raise InputError(f"--files {folder}: is no folder")
        own = _own_folders(model)
        packages = [
            next((one for one in _candidates(place) if (one / PACKAGE).is_file()), place)
            for place in own
        ]
        return cls(model, tuple(dict.fromkeys([*own, *packages, *(f.resolve() for f in named)])))

    def with_package(self, name: str) -> Reach:
        """Return a reach that includes the package of a given name, if the model lies in it.

        Args:
            name: Name of the package.

        Returns:
            The same reach, with the folder above the model that has this name. It is never the home
            folder or one above it, whatever a model calls its package.
        """
        above = (one for place in _own_folders(self.model) for one in _candidates(place))
        named = [one for one in above if one.name == name]
        return Reach(self.model, tuple(dict.fromkeys([*self.folders, *named])))

    def check(self, file: Path, what: str) -> Path:
        """Refuse a file that the model may not use.

        Args:
            file: The file; it need not exist.
            what: What it is, for the message, such as "robot file arm.urdf: mesh".

        Returns:
            The file, without symbolic links: the one that was checked.

        Raises:
            InputError: The file lies elsewhere, or a symbolic link leads elsewhere.
        """
        try:
            real = file.resolve()
        except (OSError, RuntimeError, ValueError) as error:  # a circle of links, or a NUL
            raise InputError(f"{what} {file}: cannot be read ({error})") from None
        if not self.allows(real):
            raise InputError(
                f"{what} {file}: lies outside of the model's folder {self.folders[0]}; copy it "
                "there, or let 'faultgen robot' use its folder with --files FOLDER"
            )
        return real

    def allows(self, file: Path) -> bool:
        """Tell whether a model may use a file.

        Args:
            file: A file that exists.
        """
        return any(file.resolve().is_relative_to(folder) for folder in self.folders)


def _own_folders(model: Path) -> list[Path]:
    """Folder of a model, and of the file to which it leads if it is a symbolic link."""
    return [model.parent.resolve(), model.resolve().parent]


def _candidates(place: Path) -> list[Path]:
    """Folders that can be the package of a model, from its own upwards."""
    try:
        home = Path.home().resolve()
    except (OSError, RuntimeError):  # no home
        home = Path(os.sep)
    shared = {home, *home.parents}
    return [one for one in [place, *place.parents][: _ABOVE + 1] if one not in shared]
