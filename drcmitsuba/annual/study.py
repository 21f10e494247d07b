"""Many cases from one: rows of changed keys, each light traced once, and a table of all metrics."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pandas as pd

from drcmitsuba.annual import study_facades
from drcmitsuba.annual.attributes import files_of_weather, fingerprint
from drcmitsuba.annual.result import evaluate_within
from drcmitsuba.annual.study_facades import FacadesJob
from drcmitsuba.annual.workers import Workers
from drcmitsuba.blocks.block_folder import BlockFolder
from drcmitsuba.case.case import Case
from drcmitsuba.case.shading import AREA, THRESHOLD
from drcmitsuba.case.study import Row, Study
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.content_key import content_key
from drcmitsuba.runtime.errors import BackendError, InputError
from drcmitsuba.runtime.folder_lock import locked
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.runtime.provenance import Provenance, StoredKeys
from drcmitsuba.runtime.release import RELEASE
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS
from drcmitsuba.sky.daylight import Daylight, daylight

ANNUAL, MONTHLY = ("sDA", "ASE", "shade_closed"), ("msDA", "MSE")
SEPARATOR = " | "
"""Text between two notes on a row."""
CACHE = "cache"
"""Folder of the study's own cache."""
_LAST_DAYLIGHT: dict[str, Daylight] = {}
"""Daylight of the last row by its key: a sky takes longer than all else where light is stored."""


@dataclass(frozen=True)
class StudyTable:
    """Metrics of all rows of a study; shows itself in Jupyter.

    Parameters
    ----------
    frame : pd.DataFrame
        A line for each row: its keys; `sDA`, `ASE`, `shade_closed`, `msDA_1` … `MSE_12` [%] with
        `…_low` and `…_high`, the ends of 95 % intervals; `notes` on them; `error`, the reason
        why it has no metrics.
    keys : tuple of str
        Columns that are keys.
    """

    frame: pd.DataFrame
    keys: tuple[str, ...]

    def save(self, folder: str | Path) -> None:
        """Write `table.csv`, the pictures, and `table.parquet` where pyarrow is installed."""
        from drcmitsuba.report import study_charts, style

        folder = Path(folder)
        storage.save_csv(self.frame, folder / "table.csv")
        if find_spec("pyarrow") is not None:
            with storage.whole(folder / "table.parquet") as temporary:
                _of_one_type(self.frame, self.keys).to_parquet(temporary)
        style.save_all(study_charts.charts(self.frame, self.keys), folder)

    def _repr_html_(self) -> str:
        return str(self.frame[[*self.keys, *ANNUAL, "error"]].to_html())


def _of_one_type(frame: pd.DataFrame, keys: tuple[str, ...]) -> pd.DataFrame:
    """Table whose columns have one type, as Parquet asks: numbers beside texts become texts."""
    kinds = {key: {type(value) for value in frame[key].dropna()} for key in keys}
    mixed = [key for key, types in kinds.items() if str in types and len(types) > 1]
    texts = {key: frame[key].map(str, na_action="ignore") for key in mixed}
    return frame.assign(**texts)


def study(
    plan: Study, folder: str | Path, cache: str | Path | None = None,
    progress: Progress = lambda share: None, workers: Workers | None = None,
    tell: Callable[[str], None] = lambda line: None,
) -> StudyTable:  # fmt: skip
    """Evaluate all rows of a study; those that an earlier run has finished are read.

    Parameters
    ----------
    plan : Study
        From `case.study.load_study`.
    folder : str or Path
        Folder for the table; a row that is done stands in its folder `rows`.
    cache : str or Path, optional
        Cache of coefficients; by default one in the folder.
    progress : callable
    workers : Workers, optional
        Processes that evaluate rows, from `workers.opened`; they see the cache by the same path.
    tell : callable, optional
        Takes a line on rows and blocks that were stored before.

    Returns
    -------
    StudyTable

    Raises
    ------
    InputError
        The rows cannot be read, another run writes to the folder, or the cache is unfit. A row that
        is unfit is told in the table.
    """
    folder, rows, lines = Path(folder), plan.each(), []
    with locked(folder):
        storage.remove_abandoned(folder)
        blocks = BlockFolder.cache(folder / CACHE if cache is None else cache).telling(tell)
        _tell_stored(plan, rows, folder / "rows", tell)
        done = _evaluate_facades(plan, rows, folder / "rows", workers, progress)
        others = part(progress, done, 1.0)
        if workers is not None:
            _evaluate_elsewhere(plan, rows, folder / "rows", blocks, workers, others)
        keys = tuple(dict.fromkeys(key for row in rows for key in row))
        own = {key: plan.stated(key) for key in keys}
        for number, row in enumerate(rows, start=1):
            line = _line(plan, row, folder / "rows", blocks)
            lines.append({"row": number, **own, **row, **line})
            others(number / len(rows))
        blocks.finish()
        table = StudyTable(_ordered(pd.DataFrame(lines), keys), keys)
        table.save(folder)
    return table


def _evaluate_facades(
    plan: Study, rows: list[Row], folder: Path, workers: Workers | None, progress: Progress
) -> float:
    """Evaluate rows that differ in their façades by shared elements; return their share of all."""
    done = 0.0
    for numbers in study_facades.together(_readable(plan, rows)):
        cases = [plan.case_of(rows[number]) for number in numbers]
        light = daylight(cases[0])
        for job in study_facades.jobs(cases, light.suns):
            files = [folder / f"{_key(case)}.json" for case in job.cases]
            job = job.without([i for i, file in enumerate(files) if _stored(file) is not None])
            end = done + len(files) / len(rows)
            own, done = part(progress, done, end), end
            if not job.wanted:
                continue
            try:
                for i, metrics in _made(job, light, workers, own):
                    storage.save_json(_kept(metrics), files[i])
            except (InputError, BackendError):  # of a row, which tells it when it comes by itself
                continue
    return done


def _made(
    job: FacadesJob, light: Daylight, workers: Workers | None, progress: Progress
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the number and the metrics of each row of a job, made here or by workers."""
    if workers is None:
        yield from job.each(light, progress)
    else:
        for _, metrics in workers.each(job.split(workers.count), progress):
            yield from metrics.items()


def _readable(plan: Study, rows: list[Row]) -> Iterator[tuple[int, Case, str]]:
    """Number, case and digest of the daylight of each row that can be read."""
    for number, row in enumerate(rows):
        try:
            case = plan.case_of(row)
            weather = _weather_key(case)
        except InputError:  # which its line tells
            continue
        yield number, case, weather


@dataclass(frozen=True)
class RowJob:
    """Evaluation of a row by a worker."""

    case: Case
    cache: Path

    def make(self, progress: Progress) -> dict[str, Any]:
        """Metrics of the row; without any where it is unfit, which the caller finds, too."""
        try:
            return _numbers(self.case, BlockFolder.cache(self.cache))
        except (InputError, BackendError):
            return {}


def _evaluate_elsewhere(
    plan: Study, rows: list[Row], folder: Path, blocks: BlockFolder, workers: Workers,
    progress: Progress,
) -> None:  # fmt: skip
    """Have workers evaluate the rows that are not done: first one of each light, then the rest."""
    first, others = dict[str, Case](), dict[Path, Case]()
    for row in rows:
        try:
            case = plan.case_of(row)
            file, light = folder / f"{_key(case)}.json", _light_key(case)
        except InputError:
            continue
        if _stored(file) is None and file not in others:
            first.setdefault(light, case)
            others[file] = case
    leading = [file for file, case in others.items() if any(case is one for one in first.values())]
    following = [file for file in others if file not in leading]
    begin = 0.0
    for files in (leading, following):
        jobs = [RowJob(others[file], blocks.path.absolute()) for file in files]
        end = begin + len(files) / max(1, len(others))
        for number, numbers in workers.each(jobs, part(progress, begin, end)):
            if numbers:
                storage.save_json(numbers, files[number])
        begin = end


def _light_key(case: Case) -> str:
    """Digest of what the light of a row depends on: rows of the same one share their blocks."""
    if case.shading is not None:
        rule = {"threshold": THRESHOLD, "area": AREA}
        case = case.with_tables(shading=case.shading.model_copy(update=rule))
    return content_key(fingerprint(case, ALL_EFFECTS), case.site, case.period)


def _ordered(frame: pd.DataFrame, keys: tuple[str, ...]) -> pd.DataFrame:
    """Table with the keys first and the errors last, also where every row is wrong."""
    texts = ["notes", "error"]
    frame = frame.reindex(columns=list(dict.fromkeys([*frame.columns, *ANNUAL, *texts])))
    metrics = [name for name in frame.columns if name not in ("row", *texts, *keys)]
    return frame[["row", *keys, *metrics, *texts]]


def _tell_stored(plan: Study, rows: list[Row], folder: Path, tell: Callable[[str], None]) -> None:
    """Tell of how many rows metrics are stored, and of how many another program made them."""
    stored = StoredKeys.of(folder)
    if not stored.keys:
        return
    made = [_provenance(case) for _, case, _ in _readable(plan, rows)]
    if finished := sum(_stored(folder / f"{one.key}.json") is not None for one in made):
        tell(f"going on from {finished} of {len(rows)} rows stored in {folder}")
    if older := sum(map(stored.are_of_another_program, made)):
        tell(f"stored rows of another version, evaluated again: {older} in {folder}")


def _line(plan: Study, row: Row, folder: Path, blocks: BlockFolder) -> dict[str, Any]:
    """Metrics of a row, or its error."""
    try:
        case = plan.case_of(row)
        file = folder / f"{_key(case)}.json"
        numbers = _stored(file)
        if numbers is None:
            numbers = _numbers(case, blocks)
            storage.save_json(numbers, file)
    except (InputError, BackendError) as error:
        return {"error": str(error)}
    return {**_flat(numbers), "notes": SEPARATOR.join(numbers["notes"]), "error": ""}


def _numbers(case: Case, blocks: BlockFolder) -> dict[str, Any]:
    """Evaluate a row: its metrics."""
    return _kept(evaluate_within(case, blocks=blocks, light=_daylight(case)).metrics)


def _kept(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """Metrics that the table takes, and the notes on them."""
    numbers = {name: metrics[name] for name in (*ANNUAL, *MONTHLY)}
    return numbers | {"notes": metrics["settings"]["notes"]}


def _daylight(case: Case) -> Daylight:
    """Daylight of a row; that of the row before where both have the same weather, sky and sun."""
    key = _weather_key(case)
    if key not in _LAST_DAYLIGHT:
        _LAST_DAYLIGHT.clear()
        _LAST_DAYLIGHT[key] = daylight(case.with_dark_hours())
    return _LAST_DAYLIGHT[key]


def _weather_key(case: Case) -> str:
    """Digest of everything that the daylight of a row depends on."""
    tables = {"weather", "site", "period", "sky", "sun", "outside", "effects"}
    return content_key(case.model_dump_json(include=tables), files_of_weather(case))


def _key(case: Case) -> str:
    """Name of everything that a row's numbers depend on, the contents of its files included."""
    return _provenance(case).key


def _provenance(case: Case) -> Provenance:
    inputs = fingerprint(case, ALL_EFFECTS), case.model_dump_json(), files_of_weather(case)
    return Provenance.of(*inputs, release=RELEASE)


def _stored(file: Path) -> Mapping[str, Any] | None:
    """Metrics of a row that is done; None where there are none, or they are damaged."""
    try:
        numbers = json.loads(file.read_text(encoding="utf-8"))
        _flat(numbers)
        SEPARATOR.join(numbers["notes"])
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
