"""Provenance: which code made a result.

A stored result may be used again only if the same code would produce it. The key of that code is
computed from the version of this package, the version of MuJoCo, and a hash of every source file
that the result depends on. These files are a module and all modules of this package that it
imports, directly or indirectly, and those of packages that add effects. If a result also depends on
isolators or detectors of other packages, their code counts, too. Comments, docstrings and blank
lines do not count. Runs of datasets, interpolated cycles and all caches use this one key.

    provenance("faultgen.dataset.run").key        # 16 hexadecimal digits
    str(provenance("faultgen.dataset.run"))       # faultgen 1.0.0, MuJoCo 4.0.0, code 5b0c9c2e
"""

from __future__ import annotations

import ast
import hashlib
import io
import tokenize
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from importlib.metadata import version
from importlib.util import find_spec, resolve_name
from pathlib import Path
from typing import Any

from faultgen import plugins


@dataclass(frozen=True)
class Provenance:
    """The versions and the code that made a result."""

    faultgen_version: str
    """Version of this package."""
    mujoco_version: str
    """Version of MuJoCo."""
    code_sha256: str
    """Hash of the source files that the result depends on."""

    @classmethod
    def of(cls, attributes: Mapping[str, Any]) -> Provenance:
        """Read the provenance of a stored result from its attributes.

        Args:
            attributes: Attributes of the result by name. A missing one becomes "unknown".
        """
        return cls(*(str(attributes.get(field.name, "unknown")) for field in fields(cls)))

    @property
    def key(self) -> str:
        """A hash of the three fields, 16 hexadecimal digits."""
        text = f"{self.faultgen_version} {self.mujoco_version} {self.code_sha256}"
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def __str__(self) -> str:
        return (
            f"faultgen {self.faultgen_version}, MuJoCo {self.mujoco_version}, "
            f"code {self.code_sha256[:8]}"
        )


@lru_cache
def provenance(module: str, *groups: str, more: tuple[str, ...] = ()) -> Provenance:
    """Return the provenance of the results of a module.

    Args:
        module: Name of the module that produces the result, such as "faultgen.dataset.run".
        groups: Groups of entry points on which the result depends besides `plugins.EFFECTS`, such
            as `plugins.ISOLATORS`.
        more: Names of further modules on which the result depends.
    """
    total = hashlib.sha256()
    added = [*more]
    added += [name for group in (plugins.EFFECTS, *groups) for name in plugins.modules(group)]
    for name, path in sorted(source_files(module, *added).items()):
        total.update(f"{name}\n{code_of(path.read_text(encoding='utf-8'))}\n".encode())
    return Provenance(version("faultgen"), version("mujoco"), total.hexdigest())


def source_files(*modules: str) -> dict[str, Path]:
    """Find the source files of modules and of all modules of the same packages that they import.

    Imports that serve only type checking are ignored, as are the re-exports of faultgen itself.

    Args:
        modules: Names of modules, of this package or of packages that add effects.

    Returns:
        Paths of the source files by name of the module.
    """
    packages = {"faultgen", *(module.partition(".")[0] for module in modules)}
    found: dict[str, Path] = {}
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        if not name or name in found or name == "faultgen":
            continue
        path = _file_of(name)
        if path is None:
            continue
        found[name] = path
        package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        waiting.append(name.rpartition(".")[0])
        tree = ast.parse(path.read_text(encoding="utf-8"))
        waiting += [one for one in _imports(tree, package) if one.partition(".")[0] in packages]
    return found


def _file_of(module: str) -> Path | None:
    """The source file of a module; None if the name is not that of a module."""
    try:
        spec = find_spec(module)
    except ModuleNotFoundError:
        return None
    return Path(spec.origin) if spec is not None and spec.origin else None


def _imports(node: ast.AST, package: str) -> Iterator[str]:
    """Names that a module imports. Each may be a module, or a name within a module."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test):
            continue
        if isinstance(child, ast.Import):
            yield from (alias.name for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            base = resolve_name("." * child.level + (child.module or ""), package)
            yield base
            yield from (f"{base}.{alias.name}" for alias in child.names)
        else:
            yield from _imports(child, package)


def code_of(text: str) -> str:
    """Remove comments, docstrings, blank lines and spaces at the end of lines from source text."""
    lines = [line.rstrip() for line in text.splitlines()]
    for token in tokenize.generate_tokens(io.StringIO("\n".join(lines) + "\n").readline):
        if token.type == tokenize.COMMENT:
            row = token.start[0] - 1
            lines[row] = lines[row][: token.start[1]].rstrip()
    for node in ast.walk(ast.parse("\n".join(lines))):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            first, last = node.lineno - 1, node.end_lineno or node.lineno
            if isinstance(node.value.value, str) and not lines[first][: node.col_offset].strip():
                lines[first:last] = [""] * (last - first)
    return "\n".join(line for line in lines if line)
