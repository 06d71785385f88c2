"""What other installed packages add: effects, isolators and detectors.

Such a package declares an entry point of one of the groups below. It names an object, or a list of
objects, of the kind that the group is for:

    [project.entry-points."faultgen.isolators"]
    mine = "my_package.isolators:ISOLATORS"

A single isolator or detector needs no package: the option ``--method`` of the commands names its
class, as "my_package:MyIsolator" or "./my_file.py:MyIsolator".
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from faultgen.errors import InputError, what_it_says

EFFECTS = "faultgen.effects"
ISOLATORS = "faultgen.isolators"
DETECTORS = "faultgen.detectors"

NAMED = "FAULTGEN_METHODS"
"""Environment variable that passes the classes of ``--method`` on to worker processes."""

T = TypeVar("T")


def load(name: str) -> object:
    """Load the object that a user names.

    Args:
        name: "module:object" of an installed package or of one in the current folder, or
            "path/of/file.py:object".

    Returns:
        The object.

    Raises:
        InputError: There is no such module, file or object, or the module cannot be loaded.
    """
    place, colon, wanted = name.rpartition(":")
    if not colon or not place or not wanted:
        raise InputError(f"method '{name}': give my_package:MyClass or ./my_file.py:MyClass")
    if str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))  # a package in this folder need not be installed
    try:
        module = _module_of_file(Path(place)) if place.endswith(".py") else import_module(place)
    except InputError:
        raise
    except Exception as error:  # whatever the code of another package raises
        raise InputError(
            f"method '{name}': {place} cannot be loaded ({what_it_says(error)})"
        ) from None
    if not hasattr(module, wanted):
        raise InputError(f"method '{name}': {place} has no '{wanted}'")
    return getattr(module, wanted)


def _module_of_file(path: Path) -> ModuleType:
    """Load a file as a module that bears its name."""
    path = path.resolve()
    if not path.is_file():
        raise InputError(f"method: there is no file {path}")
    known = sys.modules.get(path.stem)
    if known is not None:
        if getattr(known, "__file__", None) == str(path):
            return known
        raise InputError(f"method: rename {path}, because another module is called {path.stem}")
    spec = spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = sys.modules[path.stem] = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[path.stem]
        raise
    return module


def use(names: Sequence[str]) -> None:
    """Let isolators and detectors take part in studies, also in worker processes.

    This must be called before the methods are imported.

    Args:
        names: Classes as in `load`.
    """
    places = [name.rpartition(":") for name in names]
    whole = [
        f"{Path(place).resolve()}:{wanted}" if place.endswith(".py") else f"{place}:{wanted}"
        for place, _, wanted in places
    ]
    os.environ[NAMED] = "\n".join(whole)
    # workers find the modules of files under their names
    folders = [str(Path(one.rpartition(":")[0]).parent) for one in whole if ".py:" in one]
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join([*folders, *([before] if before else [])])


def _named() -> list[str]:
    return [name for name in os.environ.get(NAMED, "").split("\n") if name]


def added(group: str, fits: Callable[[object], bool], what: str) -> Iterator[tuple[str, T]]:
    """Load what installed packages add to a group.

    Args:
        group: Group of entry points.
        fits: Whether an object is of the kind that the group is for.
        what: That kind in words, with its article.

    Yields:
        The value of the entry point, for messages, and one object that it names.

    Raises:
        InputError: An entry point cannot be loaded, or names something else.
    """
    for point in entry_points(group=group):
        where = f"entry point {point.value}"
        for one in _objects(point):
            if not fits(one):
                raise InputError(f"{where}: must be {what} or a list of them")
            yield where, one
    if group in (ISOLATORS, DETECTORS):
        for name in _named():
            named: Any = load(name)
            if fits(named):  # one that does not may be of the other kind
                yield f"method '{name}'", named


def _objects(point: EntryPoint) -> list[Any]:
    """Load what an entry point names.

    Raises:
        InputError: It cannot be loaded. The message names the package.
    """
    try:
        loaded = point.load()
        return list(loaded) if isinstance(loaded, Iterable) else [loaded]
    except Exception as error:  # whatever the code of another package raises
        package = f"the package '{point.dist.name}'" if point.dist else "its package"
        raise InputError(
            f"entry point {point.value}: cannot be loaded ({what_it_says(error)}); correct or "
            f"uninstall {package}"
        ) from None


def modules(group: str) -> list[str]:
    """Names of the modules that installed packages, and the option ``--method``, add to a group.

    Args:
        group: Group of entry points.

    Returns:
        The names. Each module can be loaded.

    Raises:
        InputError: An entry point cannot be loaded.
    """
    points = list(entry_points(group=group))
    for point in points:
        _objects(point)
    found = [point.module for point in points]
    if group in (ISOLATORS, DETECTORS):
        found += [getattr(load(name), "__module__", "") for name in _named()]
    return found
