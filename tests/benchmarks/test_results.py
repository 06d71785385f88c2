"""The tables of the pages are those of the saved numbers, which say what made them."""

import json
from dataclasses import replace
from importlib.util import find_spec

import parts.part
import pytest
import results
from parts.part import DOCS, GPU, ROOT, Inputs, Part
from typer.testing import CliRunner

PAGES = sorted({part.page for part in results.PARTS})
WRITE = "echo again >> calls; echo '{\"number\": 3}' > own.json"


@pytest.fixture
def part(tmp_path, monkeypatch):
    """A part whose command takes no time; its file is in a folder of the test."""
    monkeypatch.setattr(parts.part, "RESULTS", tmp_path)
    return Part(
        name="own",
        commands=(WRITE,),
        code=("parts.part",),
        page="own.md",
        table=lambda told: f"| number |\n| --- |\n| {told['number']} |",
        minutes=0.1,
    )


@pytest.mark.parametrize("page", PAGES)
def test_a_page_shows_the_saved_numbers(page):
    text = (DOCS / page).read_text(encoding="utf-8")
    assert results.rendered(page, text) == text


def test_the_table_of_scripts_names_every_script():
    """Those of the shared packages and of the parts have no line of their own."""
    folder = ROOT / "benchmarks"
    cells = [
        line.split("|")[1].strip()
        for line in (folder / "README.md").read_text().splitlines()
        if line.startswith("| ")
    ]
    listed = sorted(name for cell in cells for name in cell.split(", "))
    shared = {"laboratories", "sealed", "scoring", "parts", "results"}
    folders = [
        path.parent for path in folder.glob("*/__init__.py") if path.parent.name not in shared
    ]
    named = {f"**{one.name}**" for one in folders}
    scripts = {path.stem for one in folders for path in one.glob("[!_]*.py")}
    assert listed == sorted({"script", "---"} | named | scripts)


@pytest.mark.parametrize("one", results.PARTS, ids=lambda one: one.name)
def test_a_part_is_complete(one):
    """Its numbers are there, and what it names exists."""
    assert results.read(one) is not None
    others = one.inputs.code if one.inputs else ()
    for module in (*one.code, *others):
        assert find_spec(module), module
    for name in one.files:
        assert (ROOT / name).is_file(), name
    assert one.commands[-1].split()[-1] == one.path.name
    assert [part.name for part in results.PARTS].count(one.name) == 1


def test_numbers_are_measured_once_for_each_code(part, tmp_path):
    assert results.state(part) == "not measured"
    results.measure(part, work=tmp_path / "work")
    told = results.read(part)
    assert told["number"] == 3
    assert told["provenance"]["commands"] == [WRITE]
    assert results.state(part) == "up to date"
    other = replace(part, code=("parts.robots",))
    assert results.state(other) == f"made by other code: {part.made_by}"
    assert str(part.made_by) in results.origin(part, told)
    del told["provenance"]
    part.path.write_text(json.dumps(told))
    assert results.state(part) == "made by a version that was not recorded"


def test_a_part_depends_on_its_files_and_inputs(part, tmp_path, monkeypatch):
    monkeypatch.setattr(parts.part, "ROOT", tmp_path)
    (tmp_path / "numbers.toml").write_text("a = 1\n")
    with_file = replace(part, files=("numbers.toml",))
    before = with_file.made_by
    (tmp_path / "numbers.toml").write_text("a = 2\n")
    assert before != with_file.made_by != part.made_by
    made = Inputs(name="made", commands=(), code=("parts.robots",), minutes=1)
    assert replace(part, inputs=made).made_by != part.made_by


def test_an_interrupted_part_goes_on_where_it_stopped(part, tmp_path):
    """What was done is not done again, and the earlier numbers stay until there are new ones."""
    work = tmp_path / "work"
    part.path.write_text('{"number": 1}')
    failing = replace(part, commands=(WRITE, "test -e mended"))
    with pytest.raises(results.Failed, match="exit status 1 of `test -e mended`"):
        results.measure(failing, work=work)
    assert results.read(part) == {"number": 1}
    (folder,) = work.iterdir()
    (folder / "mended").touch()
    results.measure(failing, work=work)
    assert results.read(part)["number"] == 3
    assert (folder / "calls").read_text() == "again\n"
    with pytest.raises(results.Failed):
        results.measure(failing, again=True, work=work)


def test_inputs_are_made_before_and_once(part, tmp_path):
    made = Inputs(name="made", commands=("echo x >> file",), code=("parts.robots",), minutes=1)
    command = f'cp "$INPUTS/file" . && {WRITE}'
    for name in ("own", "other"):
        one = replace(part, inputs=made, commands=(command.replace("own.json", f"{name}.json"),))
        results.measure(replace(one, name=name), work=tmp_path / "work")
    (copy,) = (tmp_path / "work").glob("other-*/file")
    assert copy.read_text() == "x\n"


def test_commands_that_write_no_numbers_are_told(part, tmp_path):
    with pytest.raises(results.Failed, match="`true` wrote no own.json"):
        results.measure(replace(part, commands=("true",)), work=tmp_path / "work")


def test_a_table_without_a_place_is_told(part):
    part.path.write_text('{"number": 4}')
    text = "before\n<!-- own.json -->\nold\n<!-- end -->\nafter\n"
    shown = results.rendered("own.md", text, [part])
    assert "| 4 |" in shown and "old" not in shown
    assert shown.startswith("before\n") and shown.endswith("\nafter\n")
    assert results.rendered("own.md", shown, [part]) == shown
    with pytest.raises(ValueError, match="docs/own.md has no lines <!-- own.json -->"):
        results.rendered("own.md", "nothing", [part])


def test_a_part_that_cannot_run_here_says_what_it_needs(part, monkeypatch):
    monkeypatch.setattr(parts.part, "gpu", lambda: None)
    assert replace(part, needs=(GPU, "json", "no_such_module")).missing() == [
        GPU,
        "no_such_module",
    ]


def test_an_unknown_part_is_refused_with_the_choices():
    done = CliRunner().invoke(results.app, ["--only", "nothing"])
    assert done.exit_code == 2
    assert "no part 'nothing'" in done.output and "growth" in done.output
