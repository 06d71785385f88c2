import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def imported(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""


def test_analysis_depends_on_no_simulation():
    """`analysis` imports neither faultgen, robots nor mujoco: it works on anybody's arrays."""
    for path in (ROOT / "analysis").rglob("*.py"):
        for name in imported(path):
            assert name.split(".")[0] not in {"faultgen", "robots", "mujoco"}, (path, name)


def test_faultgen_meets_analysis_in_studies_and_reports_only():
    """Simulation and data do not depend on the methods that are measured on them."""
    for path in (ROOT / "faultgen").rglob("*.py"):
        if path.parent.name not in {"studies", "report"}:
            assert not any(name.split(".")[0] == "analysis" for name in imported(path)), path


def test_datasets_are_read_without_the_simulator():
    """Opening a dataset does not import MuJoCo."""
    code = "import faultgen, sys; faultgen.open_dataset; assert 'mujoco' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("package", ["analysis", "faultgen", "faultgen.effects"])
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
