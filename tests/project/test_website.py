"""The website and the examples in the documentation."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from conftest import HANG

from faultgen.cli import app

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def test_the_website_is_built_without_warnings(tmp_path):
    """Every link, anchor, picture and docstring that a page refers to exists."""
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", tmp_path / "site"],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=HANG,
    )
    assert done.returncode == 0, done.stderr
    assert "no such anchor" not in done.stderr and "does not contain an anchor" not in done.stderr
    for page, says in (
        ("index.html", "Generate a labelled dataset"),
        ("reference/python.html", "faultgen.robot.load_robot"),
        ("reference/analysis.html", "PCAMonitor"),
        ("reference/commands.html", "faultgen discover"),
        ("robots/puma560.html", "Corke"),
    ):
        assert says in (tmp_path / "site" / page).read_text(), page


def commands(page):
    """The faultgen commands of a page, without comments, and with 1 for variables of the shell."""
    text = re.sub(r"\$[A-Z_]+", "1", page.read_text().replace("\\\n", " "))
    return re.findall(r"^(?:    |)(?:\.venv/bin/)?(faultgen [a-z].*)$", text, re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_in_the_documentation_are_understood(page):
    """Every command and option exists, and takes what the example gives it."""
    for line in commands(page):
        words = shlex.split(line.split(" > ")[0], comments=True)[1:]
        command = typer.main.get_command(app)
        while hasattr(command, "commands"):
            name = words.pop(0)
            if name not in command.commands:
                break  # a sentence that begins with the name of the package
            command = command.commands[name]
        else:
            command.make_context(name, words)
            continue
        assert not line.startswith(("faultgen --", "faultgen -o")) and "--" not in line, line


def tables_of(text):
    """Markdown tables whose first column is of methods: cells by method and column."""
    tables = []
    for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        lines = [[cell.strip() for cell in row.strip("|").split("|")] for row in block.splitlines()]
        if lines[0][0].startswith("method"):
            tables.append({row[0]: dict(zip(lines[0], row, strict=True)) for row in lines[2:]})
    return tables


@pytest.mark.slow
def test_the_tutorial_runs(tmp_path):
    """All commands and programs of the tutorial, and of two other pages, one after another."""
    env = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}

    def run(*command):
        done = subprocess.run(
            command, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=HANG
        )
        assert done.returncode == 0, (command, done.stderr)
        return done.stdout

    text = (ROOT / "docs" / "tutorial.md").read_text()
    printed = []
    for kind, code in re.findall(r"```(sh|python)\n(.*?)```", text, re.DOTALL):
        command = ["bash", "-ec", code] if kind == "sh" else [sys.executable, "-c", code]
        printed.append(run(*command))
    assert "friction residual" in "".join(printed)
    assert (tmp_path / "wear" / "report.html").is_file()
    (told,) = tables_of(text)
    found = next(one for one in tables_of("".join(printed)) if "friction residual" in one)
    assert set(told) == {"TE 10 bins", "TE 5 bins", "own torque", "friction residual"}
    for method, cells in told.items():  # the tutorial shows some rows and columns of the table
        assert cells == {column: found[method][column] for column in cells}, method
    stored = next((tmp_path / "wear" / "runs").glob("*.h5"))
    run("faultgen", "export", str(stored), "-o", "measured.h5")
    (tmp_path / "small.toml").write_text("robots = 2\nfailing = 1\ndays = 3\n")
    run("faultgen", "fleet", "small.toml", "-o", "fleet")
    for page in ("measured", "fleet"):
        (code,) = re.findall(
            r"```python\n(.*?)```", (ROOT / "docs" / f"{page}.md").read_text(), re.DOTALL
        )
        run(sys.executable, "-c", code)
