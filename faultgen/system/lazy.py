"""Names that a package offers, and that are imported when somebody uses them.

Heavy packages (MuJoCo, pandas, SciPy, Matplotlib) take seconds to import. A command that only
refuses its input must not wait for them.

lazily(__name__, {"replay": "faultgen.discovery.replay.replay"})
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Mapping
from importlib import import_module
from types import ModuleType
from typing import Any


class _Lazy(ModuleType):
    """A package whose names are imported on first use."""

    def __getattr__(self, name: str) -> Any:
        homes = self.__dict__["_homes"]
        if name in self.__dict__["_modules"]:
            return import_module(f"{self.__name__}.{name}")
        if name not in homes:
            raise AttributeError(f"module '{self.__name__}' has no attribute '{name}'")
        return getattr(import_module(homes[name]), name)

    def __dir__(self) -> list[str]:
        return sorted({*self.__dict__.get("__all__", ()), "__all__", "__doc__", "__name__"})

    def __setattr__(self, name: str, value: Any) -> None:
        # a module of the package, once imported, must not hide the function of the same name
        if not (isinstance(value, ModuleType) and name in self.__dict__["_homes"]):
            super().__setattr__(name, value)


def lazily(package: str, homes: Mapping[str, str], modules: Collection[str] = ()) -> None:
    """Let a package offer names without importing them.

    Args:
        package: Name of the package.
        homes: Module that defines each name.
        modules: Names of its own packages that are imported on first use as well.
    """
    module = sys.modules[package]
    module.__dict__["_homes"] = homes
    module.__dict__["_modules"] = frozenset(modules)
    module.__class__ = _Lazy
