"""The notebooks: run from top to bottom by a kernel of their own; some are stored with outputs.

What a reader would see is tested: no error, nothing on stderr, every cell run, pictures drawn.
"""

import importlib.util
import re

import nbformat
import pytest
from nbclient import NotebookClient

from tests import ROOT
from tests.fast import slowly

FOLDER = ROOT / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
SLOWEST_CELL = 300
"""Seconds; on 2 cores shared with other work the slowest took a tenth of it."""
QUICK = "[period]\ndays_per_week = 1\n\n[accuracy]\nreplicates = 2\npaths = 16\n"
SHORTER = {
    "01": {"[shading]": QUICK + "\n[shading]"},
    "04": {
        "count = [6, 16]\nspacing = 0.5": "count = [2, 4]\nspacing = 2.0",
        "days_per_week = 1": "days_per_week = 1\nhours = [11, 13]",
        "replicates = 4": "replicates = 2\npaths = 32",
        "starts=2, iterations=6": "starts=2, iterations=2",
    },
    "09": {
        "months = [3, 6, 12]": "months = [3]",
        "spacing = 0.7": "spacing = 1.4",
        "replicates = 4\npaths = 64": "replicates = 2\npaths = 32",
        "iterations = 6": "iterations = 2",
        "starts=1, iterations=5": "starts=1, iterations=2",
    },
}
"""Parts of the notebooks that are run for every commit, and what makes them quick; at night all
run as they stand."""
SPEC = importlib.util.spec_from_file_location("executed", ROOT / "docs" / "executed_notebooks.py")
EXECUTED = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(EXECUTED)
LARGEST = 400_000
"""Bytes of a notebook that is stored with outputs."""
OF_A_MACHINE = re.compile(r"/(?:tmp|home|work|root|Users)/|Traceback|[Ww]arning")
notebooks = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def code(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def test_notebooks_are_there_and_the_tutorial_names_each():
    stems = [path.stem for path in NOTEBOOKS]
    numbers = [stem[:3] for stem in stems]
    assert {"01_", "02_", "03_", "04_", "05_", "06_", "07_", "08_", "09_"} <= {*numbers}
    assert len({*numbers}) == len(numbers)
    tutorial = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    assert [stem for stem in stems if f"`{stem}`" not in tutorial] == []


@notebooks
def test_notebook_is_stored_with_the_outputs_of_none_or_of_all_cells(path):
    notebook = nbformat.read(path, as_version=nbformat.NO_CONVERT)
    nbformat.validate(notebook)
    assert (notebook.nbformat, notebook.nbformat_minor) == (4, 5)
    assert notebook.metadata == EXECUTED.METADATA, "no traces of the machine that it was run on"
    for cell in notebook.cells:
        assert cell.metadata == {}
        assert cell.source.strip()
    if path.stem in EXECUTED.WITH_OUTPUTS:
        counts = [cell.execution_count for cell in code(notebook)]
        assert counts == list(range(1, len(counts) + 1))
        outputs = [output for cell in code(notebook) for output in cell.outputs]
        assert sum("image/png" in output.get("data", {}) for output in outputs) >= 2
        shown = [output.get("text", output.get("data", {}).get("text/plain")) for output in outputs]
        assert [text for text in shown if OF_A_MACHINE.search(str(text))] == []
        assert path.stat().st_size <= LARGEST
        return
    for cell in code(notebook):
        assert cell.outputs == []
        assert cell.execution_count is None


@pytest.fixture
def executed(tmp_path, monkeypatch):
    """Run a notebook, shortened, in an empty folder, with the settings of no user; return it."""
    for name in ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR"):
        monkeypatch.setenv(name, str(tmp_path / name.lower()))
    monkeypatch.setenv("JUPYTER_PLATFORM_DIRS", "1")
    (tmp_path / "work").mkdir()

    def executed(path, shorter=()):
        notebook = nbformat.read(path, as_version=4)
        for old, new in dict(shorter).items():
            (cell,) = [cell for cell in code(notebook) if old in cell.source]
            cell.source = cell.source.replace(old, new)
        NotebookClient(
            notebook, timeout=SLOWEST_CELL, kernel_name="python3",
            resources={"metadata": {"path": str(tmp_path / "work")}},
        ).execute()  # fmt: skip
        return notebook

    return executed


@pytest.mark.parametrize("number", slowly([*SHORTER], "04", "09"))
def test_a_shorter_notebook_runs(number, executed):
    (path,) = FOLDER.glob(f"{number}_*.ipynb")
    check(executed(path, SHORTER[number]))


@pytest.mark.slow
@notebooks
def test_notebook_runs(path, executed):
    check(executed(path))


def check(notebook):
    """Assert that every cell ran without a warning, and that pictures were drawn."""
    outputs = [output for cell in code(notebook) for output in cell.outputs]
    assert all(cell.execution_count for cell in code(notebook))
    assert [o.text for o in outputs if o.output_type == "stream" and o.name == "stderr"] == []
    assert [o for o in outputs if o.output_type == "error"] == []
    pictures = [o for o in outputs if "image/png" in o.get("data", {})]
    assert len(pictures) >= 2


def test_a_warning_would_be_noticed(tmp_path, executed):
    source = "import warnings\nwarnings.warn('beware', stacklevel=1)"
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source)])
    nbformat.write(notebook, tmp_path / "warns.ipynb")
    (output,) = executed(tmp_path / "warns.ipynb").cells[0].outputs
    assert (output.output_type, output.name) == ("stream", "stderr")
    assert "beware" in output.text
