"""The tour: a notebook that runs from top to bottom, without outputs in the repository, with public names."""

import ast
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from .test_front_door import behind

ROOT = Path(__file__).resolve().parents[2]
TOUR = ROOT / "examples" / "tour.ipynb"
PATIENCE = 900
"""Longest time of a cell [s]: the first one that steps compiles kernels."""


def notebook():
    return nbformat.read(TOUR, as_version=4)


def sources(kind):
    return [cell.source for cell in notebook().cells if cell.cell_type == kind]


def test_it_is_a_notebook_without_outputs():
    nbformat.validate(notebook())
    for cell in notebook().cells:
        if cell.cell_type == "code":
            assert cell.outputs == []
            assert cell.execution_count is None


def test_it_shows_simulation_sensors_viewer_and_training_by_public_names():
    code = "\n".join(sources("code"))
    assert behind(code) == []
    for name in ("Simulation(", "Camera(", "Lidar(", "LiveView(", "train("):
        assert name in code, name
    ast.parse(code)
    assert len(sources("markdown")) >= 5


def test_pages_that_it_names_are_there_and_lead_to_it():
    text = "\n".join(sources("markdown"))
    pages = [word for word in text.replace("`", " ").split() if word.startswith("docs/")]
    assert pages
    assert all((ROOT / page.rstrip(",:;.")).is_file() for page in pages)
    for page in ("README.md", "docs/index.md"):
        assert "examples/tour.ipynb" in (ROOT / page).read_text(encoding="utf-8"), page


@pytest.mark.slow
def test_it_runs_from_top_to_bottom(tmp_path):
    book = notebook()
    NotebookClient(
        book, timeout=PATIENCE, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    outputs = [output for cell in book.cells for output in cell.get("outputs", [])]
    pictures = sum("image/png" in output.get("data", {}) for output in outputs)
    assert pictures == 3  # heights, images of cameras, the learning curve
    # The page of the viewer and the film; the progress of the training is HTML that is displayed on the way
    assert sum("text/html" in each.data for each in outputs if each.output_type == "execute_result") == 2
    printed = "".join(output.get("text", "") for output in outputs)
    assert "mean reward" in printed
    assert list(tmp_path.iterdir()) == []  # what it writes is in a folder of its own
