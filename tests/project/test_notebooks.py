"""The notebooks run from their first to their last cell."""

from pathlib import Path

import nbformat
import pytest
from conftest import HANG
from nbclient import NotebookClient

NOTEBOOKS = sorted((Path(__file__).parents[2] / "docs" / "notebooks").glob("*.ipynb"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "path",
    [pytest.param(path, id=path.stem) for path in NOTEBOOKS],
)
def test_notebooks_run(path, tmp_path):
    book = nbformat.read(path, as_version=4)
    assert not any(cell.get("outputs") for cell in book.cells), "clear the outputs before a commit"
    client = NotebookClient(book, timeout=HANG, resources={"metadata": {"path": str(tmp_path)}})
    client.execute()
    printed = "".join(
        output.get("text", "") for cell in book.cells for output in cell.get("outputs", [])
    )
    expected = {
        "isolators": "% of the test cycles are right",
        "discovery": "viscous_friction on axis 2: between",
    }
    assert expected[path.stem] in printed
