"""Imports go in one direction, and the folders show the flow of the data."""

import ast
import importlib
import subprocess
import sys
import tomllib
from importlib.util import resolve_name
from pathlib import Path

import pytest

import faultgen

ROOT = Path(__file__).parents[2]
SOURCES = {"faultgen": ROOT / "faultgen", "faultgen.analysis": ROOT / "analysis"}

PUBLIC = set(
    """
    Discovery InputError Judge Monitor Recording SimulationFailed __version__ analysis
    calibrate datasets detect discover generate generate_fleet import_log isolate load_detector
    load_fleet load_monitor load_robot make_twin open_dataset open_fleet open_parts read_recording
    run_benchmark run_study train write_recording write_report
    """.split()
)
"""Public names. A change here is a change of the interface."""


def modules():
    """Path of every module of the package, by name."""
    found = {}
    for package, folder in SOURCES.items():
        for path in folder.rglob("*.py"):
            parts = path.relative_to(folder).with_suffix("").parts
            found[".".join([package, *parts]).removesuffix(".__init__")] = path
    return found


MODULES = modules()


def imports(node, package, types=False):
    """Modules that code imports when it runs, also within functions; or those for types too."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test) and not types:
            continue
        if isinstance(child, ast.Import):
            yield from (alias.name for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            base = resolve_name("." * child.level + (child.module or ""), package)
            for alias in child.names:
                inner = f"{base}.{alias.name}"
                yield inner if inner in MODULES else base
        else:
            yield from imports(child, package, types)


def imported(name, types=False):
    path = MODULES[name]
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    return set(imports(ast.parse(path.read_text()), package, types)) - {name}


# the package itself re-exports the public names, and nothing imports it
GRAPH = {name: imported(name) & MODULES.keys() for name in MODULES if name != "faultgen"}


def circle(graph):
    """Nodes of a circle of a graph; empty if there is none."""
    done, path = set(), []

    def visit(node):
        if node in path:
            return path[path.index(node) :]
        if node in done:
            return []
        path.append(node)
        for following in sorted(graph.get(node, ())):
            found = visit(following)
            if found:
                return found
        done.add(path.pop())
        return []

    return next(filter(None, map(visit, sorted(graph))), [])


def test_modules_import_each_other_without_circles():
    """No module needs, directly or not, a module that needs it."""
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"a"}}) == ["a", "b", "c"]
    assert circle(GRAPH) == []


def test_types_need_no_circles_either():
    """Nor does a module name a type of a module that needs it."""
    graph = {name: imported(name, types=True) & MODULES.keys() for name in GRAPH}
    guarded = ast.parse("if TYPE_CHECKING:\n    import faultgen.robot")
    assert list(imports(guarded, "", types=True)) == ["faultgen.robot"]
    assert circle(graph) == []


def folder_of(name):
    return ".".join(name.split(".")[:2])


def test_folders_import_each_other_in_one_direction():
    """The folders, too, can be put in an order in which each uses only those before it."""
    folders = {}
    for name, others in GRAPH.items():
        others = {folder_of(other) for other in others} - {folder_of(name)}
        folders.setdefault(folder_of(name), set()).update(others)
    assert {"faultgen.simulation", "faultgen.dataset", "faultgen.analysis"} <= folders.keys()
    assert circle(folders) == []


def test_parts_of_discovery_import_each_other_in_one_direction():
    """So can the packages within discovery; what is at the top of discovery belongs to none."""
    parts = {}
    for name, others in GRAPH.items():
        if name.startswith("faultgen.discovery.") and name.count(".") == 3:
            part = name.rpartition(".")[0]
            used = {other.rpartition(".")[0] for other in others if other.count(".") == 3}
            used = {other for other in used if other.startswith("faultgen.discovery.")}
            parts.setdefault(part, set()).update(used - {part})
    assert {"faultgen.discovery.terms", "faultgen.discovery.decision"} <= parts.keys()
    assert parts["faultgen.discovery.decision"]
    assert circle(parts) == []


def test_recordings_need_no_discovery():
    """Data are read and checked without the modules that explain them."""
    above = {"faultgen.discovery", "faultgen.twin", "faultgen.cli", "faultgen.report"}
    names = [name for name in GRAPH if folder_of(name) == "faultgen.recordings"]
    assert "faultgen.recordings.checks" in names
    for name in names:
        found = {folder_of(other) for other in imported(name, types=True)}
        assert not found & above, name


def test_analysis_depends_on_no_simulation():
    """`analysis` imports nothing else of faultgen, nor mujoco: it works on anybody's arrays."""
    for name in MODULES:
        if folder_of(name) == "faultgen.analysis":
            for other in imported(name):
                assert folder_of(other) == "faultgen.analysis" or not other.startswith(
                    ("faultgen", "mujoco")
                ), (name, other)


def test_faultgen_meets_analysis_in_evaluation_studies_reports_and_twins_only():
    """Simulation and data do not depend on the methods that are measured on them."""
    meeting = {"analysis", "evaluation", "studies", "report", "twin"}
    meeting = {f"faultgen.{name}" for name in meeting}
    for name, others in GRAPH.items():
        if folder_of(name) not in meeting:
            assert not any(folder_of(other) == "faultgen.analysis" for other in others), name


def test_the_public_names_are_those_that_are_listed():
    """`dir(faultgen)` shows every command's function or class, and nothing else; all exist."""
    own = {name for name in dir(faultgen) if name not in ("__all__", "__doc__", "__name__")}
    assert own == set(faultgen.__all__) == PUBLIC
    for name in PUBLIC:
        assert getattr(faultgen, name) is not None


def test_every_package_is_installed():
    """The list of packages in pyproject.toml has every folder with code."""
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    there = {name for name, path in MODULES.items() if path.name == "__init__.py"}
    assert set(listed) == there | {"faultgen.robots"}


def test_datasets_are_read_without_the_simulator():
    """Opening a dataset does not import MuJoCo."""
    code = "import faultgen, sys; faultgen.open_dataset; assert 'mujoco' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    "package", ["faultgen.analysis", "faultgen", "faultgen.effects", "faultgen.dataset"]
)
def test_public_names_resolve(package):
    """Every name in __all__ is there."""
    module = importlib.import_module(package)
    for name in module.__all__:
        assert getattr(module, name) is not None


def test_unknown_names_are_errors():
    """The lazy package does not make names up."""
    import faultgen

    with pytest.raises(AttributeError, match="no attribute 'generator'"):
        _ = faultgen.generator


OF_NOTEBOOKS = "_repr_html_"  # the method that notebooks call, by its public name


def private_names(tree):
    """Private names of other modules that code uses: imported, looked up, or given as a text."""
    theirs = {"self", "cls", *sys.stdlib_module_names}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            used = [alias.name for alias in node.names]
        elif isinstance(node, ast.Attribute):
            root = node.value.id if isinstance(node.value, ast.Name) else None
            used = [] if root in theirs else [node.attr]
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("setattr", "getattr")):
            texts = [one.value for one in node.args if isinstance(one, ast.Constant)]
            used = [text.rpartition(".")[2] for text in texts if isinstance(text, str)]
        else:
            continue
        hidden = (name for name in used if name.startswith("_") and not name.startswith("__"))
        yield from (name for name in hidden if name != OF_NOTEBOOKS)


@pytest.mark.parametrize(
    "code",
    [
        "from faultgen.tasks import load_task, _hidden",
        "import faultgen.tasks as tasks; tasks._hidden()",
        "isolator.fit(x)._hidden",
        'monkeypatch.setattr(tasks, "_hidden", None)',
        'monkeypatch.setattr("faultgen.tasks._hidden", None)',
        'getattr(tasks, "_hidden")',
    ],
)
def test_uses_of_private_names_are_found(code):
    assert list(private_names(ast.parse(code))) == ["_hidden"]
    assert list(private_names(ast.parse(code.replace("_hidden", "__name__")))) == []


def test_tests_use_public_names_only():
    """A test that needs a private name would break when code is rewritten that still works."""
    found = {
        path.name: names
        for path in sorted((ROOT / "tests").rglob("*.py"))
        if (names := set(private_names(ast.parse(path.read_text()))))
    }
    assert found == {}
