"""Many cases from one: rows of changed keys, each light traced once, and a table of all metrics."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pandas as pd

from drcmitsuba.annual.attributes import fingerprint
from drcmitsuba.annual.result import evaluate_within
from drcmitsuba.blocks.block_folder import BlockFolder
from drcmitsuba.blocks.content_key import content_key
from drcmitsuba.case.case import Case
from drcmitsuba.case.study import Row, Study
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import BackendError, InputError
from drcmitsuba.runtime.folder_lock import locked
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS

ANNUAL, MONTHLY = ("sDA", "ASE", "shade_closed"), ("msDA", "MSE")
CACHE = "cache"
"""Folder of the study's own cache."""


@dataclass(frozen=True)
class StudyTable:
    """Metrics of all rows of a study; shows itself in Jupyter.

    Parameters
    ----------
    frame : pd.DataFrame
        A line for each row: its keys; `sDA`, `ASE`, `shade_closed`, `msDA_1` … `MSE_12` [%] with
        `…_low` and `…_high`, the ends of 95 % intervals; `error`, the reason why it has no metrics.
    keys : tuple of str
        Columns that are keys.
    """

    frame: pd.DataFrame
    keys: tuple[str, ...]

    def save(self, folder: Path) -> None:
        """Write `table.csv`, the pictures, and `table.parquet` where pyarrow is installed."""
        from drcmitsuba.report import study_charts, style

        storage.save_csv(self.frame, folder / "table.csv")
        if find_spec("pyarrow") is not None:
            with storage.whole(folder / "table.parquet") as temporary:
                self.frame.to_parquet(temporary)
        for name, figure in study_charts.charts(self.frame, self.keys).items():
            style.save(figure, folder / name)

    def _repr_html_(self) -> str:
        return str(self.frame[[*self.keys, *ANNUAL, "error"]].to_html())


def study(
    plan: Study, folder: Path, cache: str | Path | None = None,
    progress: Progress = lambda share: None,
) -> StudyTable:  # fmt: skip
    """Evaluate all rows of a study; those that an earlier run has finished are read.

    Parameters
    ----------
    plan : Study
        From `case.study.load_study`.
    folder : Path
        Folder for the table; a row that is done stands in its folder `rows`.
    cache : str or Path, optional
        Cache of coefficients; by default one in the folder.
    progress : callable

    Returns
    -------
    StudyTable

    Raises
    ------
    InputError
        The rows cannot be read, another run writes to the folder, or the cache is unfit. A row that
        is unfit is told in the table.
    """
    rows, lines = plan.each(), []
    with locked(folder):
        storage.remove_abandoned(folder)
        blocks = BlockFolder.cache(folder / CACHE if cache is None else cache)
        for number, row in enumerate(rows, start=1):
            lines.append({"row": number, **row, **_line(plan, row, folder / "rows", blocks)})
            progress(number / len(rows))
        blocks.finish()
        keys = tuple(dict.fromkeys(key for row in rows for key in row))
        table = StudyTable(_ordered(pd.DataFrame(lines), keys), keys)
        table.save(folder)
    return table


def _ordered(frame: pd.DataFrame, keys: tuple[str, ...]) -> pd.DataFrame:
    """Table with the keys first and the errors last, also where every row is wrong."""
    frame = frame.reindex(columns=list(dict.fromkeys([*frame.columns, *ANNUAL, "error"])))
    metrics = [name for name in frame.columns if name not in ("row", "error", *keys)]
    return frame[["row", *keys, *metrics, "error"]]


def _line(plan: Study, row: Row, folder: Path, blocks: BlockFolder) -> dict[str, Any]:
    """Metrics of a row, or its error."""
    try:
        case = plan.case_of(row)
        file = folder / f"{_key(case)}.json"
        numbers = _stored(file)
        if numbers is None:
            numbers = evaluate_within(case, blocks=blocks).metrics
            numbers = {name: numbers[name] for name in (*ANNUAL, *MONTHLY)}
            storage.save_json(numbers, file)
    except (InputError, BackendError) as error:
        return {"error": str(error)}
    return {**_flat(numbers), "error": ""}


def _key(case: Case) -> str:
    """Digest of everything that a row's numbers depend on, the contents of its files included."""
    files = [case.path(f) for f in (case.weather.file, case.period.timestamps) if f is not None]
    contents = [file for file in files if file.is_file()]
    program = version("drcmitsuba"), fingerprint(case, ALL_EFFECTS)
    return content_key(program, case.model_dump_json(), contents)


def _stored(file: Path) -> Mapping[str, Any] | None:
    """Metrics of a row that is done; None where there are none, or they are damaged."""
    try:
        numbers = json.loads(file.read_text(encoding="utf-8"))
        _flat(numbers)
    except (OSError, ValueError, TypeError, KeyError):
        return None
    return dict(numbers)


def _flat(numbers: Mapping[str, Any]) -> dict[str, float]:
    """Columns of a row: values and ends of intervals [%]."""
    named = {name: numbers[name] for name in ANNUAL}
    for name in MONTHLY:
        named |= {f"{name}_{month}": n for month, n in enumerate(numbers[name], 1) if n is not None}
    return {
        name + suffix: float(number[part])
        for name, number in named.items()
        for part, suffix in (("value", ""), ("low", "_low"), ("high", "_high"))
    }
