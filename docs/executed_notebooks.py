"""Run notebooks and store their outputs: python docs/executed_notebooks.py [STEM …].

Without a name, all that are stored with outputs; the others are stored without.
"""

from __future__ import annotations

import base64
import io
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from PIL import Image

NOTEBOOKS = Path(__file__).resolve().parent.parent / "notebooks"
WITH_OUTPUTS = ("01_first_room", "04_film_optimisation", "09_two_rooms")
"""First year, film design, façade search."""
METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}


def execute(notebook: Any, seconds: float) -> Any:
    """Run a notebook from top to bottom in an empty folder; no cell may take longer."""
    with tempfile.TemporaryDirectory() as folder:
        where = {"metadata": {"path": folder}}
        NotebookClient(
            notebook, timeout=seconds, kernel_name="python3", resources=where
        ).execute()  # fmt: skip
    return notebook


def store(notebook: Any, path: Path) -> None:
    """Write a notebook with pictures of 256 colours, without traces of machine and time."""
    notebook.metadata = nbformat.from_dict(METADATA)
    for cell in notebook.cells:
        cell.metadata = nbformat.from_dict({})
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            if "image/png" in data:
                with Image.open(io.BytesIO(base64.b64decode(data["image/png"]))) as picture:
                    few = picture.convert("RGB").quantize(256, dither=Image.Dither.NONE)
                file = io.BytesIO()
                few.save(file, "PNG", optimize=True)
                data["image/png"] = base64.b64encode(file.getvalue()).decode()
    nbformat.write(notebook, path)


def main(stems: list[str]) -> None:
    """Run notebooks and store their outputs."""
    for stem in stems or WITH_OUTPUTS:
        path = NOTEBOOKS / f"{stem}.ipynb"
        store(execute(nbformat.read(path, as_version=4), 600.0), path)
        print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
