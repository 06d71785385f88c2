"""The key of the code: what it depends on, and what it does not depend on."""

import subprocess
import sys

import pytest

import faultgen.provenance as provenance_module
from faultgen.provenance import code_of, provenance, source_files

CODE = '''
"""Docstring of the module."""
from a import b  # why


class One:
    """A class."""

    size: int = 3
    """A field."""

    def two(self, text="# no comment"):
        """A method."""
        return f"{text} is {self.size}"  # said
'''


def test_comments_and_docstrings_do_not_count():
    """The code is what is left without them, and without blank lines."""
    assert code_of(CODE) == (
        "from a import b\nclass One:\n    size: int = 3\n"
        '    def two(self, text="# no comment"):\n        return f"{text} is {self.size}"'
    )
    assert code_of(CODE.replace("A method.", "Another\n        text.")) == code_of(CODE)
    assert code_of(CODE.replace("size: int = 3", "size: int = 4")) != code_of(CODE)


def test_a_run_depends_on_what_simulates_it():
    """Physics, noise and storage belong to a run; analysis, reports and the command line do not."""
    names = set(source_files("faultgen.dataset.run"))
    assert {
        "faultgen.simulation.stepping",
        "faultgen.effects.friction",
        "faultgen.monitoring.sensors",
    } <= names
    assert {
        "faultgen.simulation.motion",
        "faultgen.dataset.storage",
        "faultgen.dataset.run",
    } <= names
    assert not [name for name in names if name.startswith(("faultgen.cli", "faultgen.studies"))]
    assert not [
        name
        for name in names
        if name.startswith(("faultgen.analysis", "faultgen.discovery", "faultgen.recordings"))
    ]


def test_every_imported_module_counts():
    """The modules that Python really loads for a run are among the source files."""
    code = (
        "import sys, faultgen.dataset.run\n"
        "print(*[name for name in sys.modules if name.startswith('faultgen.')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    # the package itself imports its readers and what offers its names; no run depends on them
    others = {f"faultgen.dataset.{name}" for name in ("reader", "manifest", "parted")}
    others |= {"faultgen.system.lazy"}
    assert set(done.stdout.split()) - others <= set(source_files("faultgen.dataset.run"))


@pytest.mark.parametrize("module", ["faultgen.dataset.run", "faultgen.simulation.surrogate"])
def test_a_changed_law_changes_the_key(monkeypatch, module):
    """One changed number in the friction law gives another key; a changed comment does not."""
    path = source_files(module)["faultgen.effects.friction"]
    real = provenance_module.code_of
    before = provenance(module)

    def key_with(change):
        provenance.cache_clear()
        changed = change(path.read_text())
        monkeypatch.setattr(
            provenance_module,
            "code_of",
            lambda text: real(changed if text == path.read_text() else text),
        )
        found = provenance(module).key
        monkeypatch.undo()
        provenance.cache_clear()
        return found

    assert key_with(lambda text: text + "\n# a comment\n") == before.key
    assert key_with(lambda text: text + "\nfactor = 2\n") != before.key
    assert str(before).startswith("faultgen 1.0.0, MuJoCo 4.")
