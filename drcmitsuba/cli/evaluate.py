"""The command `drcmitsuba evaluate`."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli.options import (
    Cache,
    CaseName,
    Output,
    Scheduler,
    Weather,
    WorkerCount,
    load,
    option,
)
from drcmitsuba.cli.startup import FOR_FILES, FOR_METRICS, importing
from drcmitsuba.cli.terminal import percent, show, show_notes, show_progress, stages
from drcmitsuba.runtime.background import Behind
from drcmitsuba.runtime.byte_size import in_words, size_on_disk
from drcmitsuba.runtime.errors import InputError, on_a_line
from drcmitsuba.runtime.folder_lock import locked

if TYPE_CHECKING:
    from drcmitsuba.annual.saved_result import SavedResult
    from drcmitsuba.case.case import Case


SIDE_BY_SIDE = (
    "off: variants.png has all façades side by side; "
    'pictures = "all" in [effects] draws those of each, too'
)
"""Why the folder of a variant has no pictures."""
MOST_ROWS = 40
"""Largest number of grids in the table."""
LIGHT = (("ratio", 2), ("cct", 0), ("fidelity", 0))
"""Columns on the colour of light, and their digits."""
SHORT = "…"
"""Text between the ends of intervals where many columns share 80 characters."""


def metrics_tables(numbers: dict, title: str) -> list[Table]:
    """Tables of the metrics of the period, of its months, and of the grids where there are several.

    The rows of the shade are left out where the settings have none.
    """
    from drcmitsuba.case.weather import PeriodTable
    from drcmitsuba.report.captions import period_name

    settings = numbers.get("settings", {})
    has_shade = bool("shading" in settings or settings.get("groups") or not settings)
    groups = len(numbers.get("groups", {}))
    closed = f"shade closed, mean of {groups} groups" if groups > 1 else "shade closed"
    labels = {"sDA": "sDA", "ASE": "ASE"} | ({"shade_closed": closed} if has_shade else {})
    whole = Table(title=escape(title), title_justify="left")
    whole.add_column(period_name(PeriodTable(**settings.get("period", {}))))
    whole.add_column("% (95 % interval)", justify="right")
    for name, label in labels.items():
        whole.add_row(label, percent(numbers[name]))
    monthly = {"msDA": "msDA %", "MSE": "MSE %"}
    monthly |= {"shade_closed_monthly": "shade closed %"} if has_shade else {}
    months = Table("month", *monthly.values())
    rows = zip(*(numbers[name] for name in monthly), strict=True)
    for month, row in enumerate(rows, start=1):
        months.add_row(str(month), *(percent(value) for value in row))
    parts = _spaces_table(numbers) or _grids_table(numbers)
    return [whole, months, *_groups_table(numbers), *parts, *_melanopic_table(numbers)]


def _groups_table(numbers: dict) -> list[Table]:
    """Table with a row for each group of panes; none where all panes close together."""
    groups = numbers.get("groups", {})
    if not groups:
        return []
    table = Table("group of panes", "state: % of the hours")
    for name, shares in groups.items():
        states = ", ".join(f"{on_a_line(state)} {share:.1f}" for state, share in shares.items())
        table.add_row(escape(on_a_line(name)), escape(states))
    return [table]


def _spaces_table(numbers: dict) -> list[Table]:
    """Table of the spaces, those with least daylight first, and of the building by area.

    There is none where the case tells no spaces apart.
    """
    from drcmitsuba.metrics.metrics_of_spaces import darkest_first

    spaces = numbers.get("spaces", [])
    if len(spaces) < 2:
        return []
    table = Table("space")
    for column in ("m²", "sDA % (95 %)", "ASE % (95 %)"):
        table.add_column(column, justify="right", no_wrap=True)
    worst = darkest_first(spaces)
    for space in [*worst[:MOST_ROWS], {"name": "building, by area", **numbers["building"]}]:
        words = (on_a_line(space.get(key, "")) for key in ("name", "use", "storey"))
        shares = (percent(space[metric], SHORT) for metric in ("sDA", "ASE"))
        table.add_row(escape(", ".join(filter(None, words))), f"{space['floor_area']:.1f}", *shares)
    if len(spaces) > MOST_ROWS:
        table.caption = f"{len(spaces) - MOST_ROWS} more spaces: metrics.json, spaces"
    return [table]


def _melanopic_table(numbers: dict) -> list[Table]:
    """Table of melanopic light at the sensors and at each view; none without bands."""
    told = numbers.get("melanopic")
    if not told:
        return []
    table = Table(f"melanopic EDI, {told['threshold']:g} lx")
    for column in ("% of hours", "% of mornings", "per lx", "CCT [K]", "R_f"):
        table.add_column(column, justify="right", no_wrap=True)
    views = told.get("views", {})
    for name, row in [("sensors", told), *list(views.items())[:MOST_ROWS]]:
        mornings = percent(row["mornings"], SHORT) if "mornings" in row else "–"
        light = [(row.get(key), digits) for key, digits in LIGHT]
        lit = ["–" if value is None else f"{value:.{digits}f}" for value, digits in light]
        table.add_row(escape(on_a_line(name)), percent(row["autonomy"], SHORT), mornings, *lit)
    if len(views) > MOST_ROWS:
        table.caption = f"{len(views) - MOST_ROWS} more views: metrics.json, melanopic"
    return [table]


def _grids_table(numbers: dict) -> list[Table]:
    """Table with a row for each grid; none where there are no grids."""
    grids = numbers.get("grids", {})
    if not grids:
        return []
    table = Table("grid")
    for column in ("points", "sDA % (95 %)", "ASE % (95 %)"):
        table.add_column(column, justify="right")
    for name, grid in list(grids.items())[:MOST_ROWS]:
        shares = (percent(grid[metric]) for metric in ("sDA", "ASE"))
        table.add_row(escape(on_a_line(name)), str(grid["sensors"]), *shares)
    if len(grids) > MOST_ROWS:
        table.caption = f"{len(grids) - MOST_ROWS} more grids: metrics.json, grids"
    return [table]


def evaluate(
    case: CaseName,
    output: Output = Path("results"),
    weather: Weather = None,
    coefficients: Annotated[
        Path | None,
        option("FOLDER", "coefficients.zarr of this case; any weather may have made it."),
    ] = None,
    cache: Cache = None,
    memory: Annotated[
        str | None,
        option("SIZE", 'Memory to keep within, as "3 GiB": arrays that do not fit are summed.'),
    ] = None,
    workers: WorkerCount = None,
    scheduler: Scheduler = None,
    block: Annotated[
        str | None,
        option("I/N", "Make one of N parts of the blocks in the cache, and no results."),
    ] = None,
    spaces: Annotated[
        str | None,
        option("NAMES", 'Spaces, such as Office*,Hall; a name with a comma stands in "quotes".'),
    ] = None,
    variants: Annotated[
        str | None,
        option("NAMES", "Other façades: cases beside this one, such as o1,o2; each gets a folder."),
    ] = None,
) -> None:
    """Evaluate a year: illuminance, sDA, ASE, msDA, MSE, plots."""
    if variants is not None:
        _refuse_beside("--variants", {
            "--coefficients": coefficients, "--cache": cache, "--memory": memory,
            "--workers": workers, "--scheduler": scheduler, "--block": block, "--spaces": spaces,
        })  # fmt: skip
        with locked(output):
            _evaluate_variants(case, [*map(str.strip, variants.split(","))], output, weather)
        return
    chosen = load(case, weather).with_spaces(_names(spaces) if spaces is not None else ())
    if block is not None:
        _refuse_beside("--block", {
            "--coefficients": coefficients, "--memory": memory, "--workers": workers,
            "--scheduler": scheduler,
        })  # fmt: skip
        _make_part(chosen, block, cache)
        return
    from drcmitsuba import evaluate_within
    from drcmitsuba.annual.workers import opened
    from drcmitsuba.blocks.block_folder import BlockFolder
    from drcmitsuba.metrics import stored_arrays
    from drcmitsuba.runtime import storage
    from drcmitsuba.runtime.byte_size import byte_size

    most = None if memory is None else byte_size(memory, "--memory")
    known = None
    if coefficients is not None:
        known = stored_arrays.open_dataset(coefficients, "replicates", "straight", "state")
        known = stored_arrays.loaded(coefficients, known)
    with locked(output):
        storage.remove_abandoned(output)
        blocks = BlockFolder.of_results(output) if cache is None else BlockFolder.cache(cache)
        blocks = blocks.telling(show_progress)
        with stages() as stage:
            work = importing(stage, *FOR_METRICS, *FOR_FILES)
            with opened(workers, scheduler) as others:
                result = evaluate_within(chosen, work, known, blocks, most, others)
            result.save(output, stage)
        blocks.finish()
    _show_result(result, output)


def _names(text: str) -> list[str]:
    """Names between commas."""
    try:
        names = [*filter(None, map(str.strip, next(csv.reader([text], skipinitialspace=True))))]
    except csv.Error:
        names = []
    if not names:
        raise InputError("command line", "--spaces", repr(text)[:60], "give names between commas")
    return names


def _refuse_beside(option: str, others: Mapping[str, object]) -> None:
    """Refuse other options, values by name, beside one that leaves them out."""
    for name, value in others.items():
        if value is not None:
            raise InputError("command line", name, f"beside {option}", "give one of them")


def _make_part(case: Case, block: str, cache: Path | None) -> None:
    """Make a part of the blocks in a cache."""
    from drcmitsuba.annual.block_parts import make_part
    from drcmitsuba.blocks.block_folder import BlockFolder
    from drcmitsuba.blocks.part import BlockPart

    which = BlockPart.of(block)
    if cache is None:
        remedy = "name the folder that all parts share: --cache FOLDER"
        raise InputError("command line", "--block", "no --cache", remedy)
    blocks = BlockFolder.cache(cache).telling(show_progress)
    with stages() as stage:
        make_part(case, blocks, which, stage)
    show_notes(blocks.notes)
    print(f"part {which} of the blocks is in {cache}; the same command without --block evaluates")


def _show_result(result: SavedResult, output: Path) -> None:
    numbers = result.metrics
    show(*metrics_tables(numbers, result.case.name))
    if "accuracy" in numbers:
        accuracy = numbers["accuracy"]
        half_width = f"rounds: {accuracy['rounds']}, ±{accuracy['half_width']:.2g}"
        print(f"{accuracy['reason']}: {half_width}, wanted ±{accuracy['target']}")
    if numbers["undecided"]:
        count = Counter(point["metric"] for point in numbers["undecided"])
        points = ", ".join(f"{count[name]} of {name}" for name in ("sDA", "ASE"))
        print(f"points too close to call: {points} (metrics.json, undecided)")
    show_notes(numbers["settings"]["notes"])
    print(f"results are in {output}, {in_words(size_on_disk(output))}")


def _evaluate_variants(case: str, names: list[str], output: Path, weather: Path | None) -> None:
    """Evaluate several façades of one room from one simulation."""
    from drcmitsuba.annual.variants import evaluate_variants, load_variants
    from drcmitsuba.report.side_by_side import FacadeOfPicture, side_by_side
    from drcmitsuba.report.standing import DrawnParts
    from drcmitsuba.report.style import save_all

    cases = [c.with_weather(weather) for c in load_variants(case, names)]
    pictures = cases[0].effects.pictures  # as in all of them
    metrics, drawn, shares, names_drawn = {}, DrawnParts(), list[FacadeOfPicture](), list[str]()
    with stages() as stage, (saving := Behind()).opened():
        results = evaluate_variants(cases, stage)
        for name, result in zip([Path(case).stem, *names], results, strict=True):
            E = result.illuminance.load()  # the device serves one thread
            if pictures != "off":
                shares.append(FacadeOfPicture.of(name, result.case, E, result.metrics))
            kept = result.without_pictures(SIDE_BY_SIDE) if pictures == "auto" else result
            saving.do(partial(kept.save, output / name, stage, drawn))
            metrics[name] = result.metrics
            if result.case.output.illuminance == "all":  # coefficients are made as they are written
                saving.wait()
            del result, kept
        if shares:
            with stage("pictures") as done:
                names_drawn = [path.name for path in save_all(side_by_side(shares), output, done)]
        for old in (*output.glob("variants.png"), *output.glob("variants_[0-9]*.png")):
            if old.name not in names_drawn:
                old.unlink()
    table = Table("façade", *(f"{n} % (95 %)" for n in ("sDA", "ASE", "shade closed")))
    for name, numbers in metrics.items():
        table.add_row(escape(name), *(percent(numbers[n]) for n in ("sDA", "ASE", "shade_closed")))
    show(table)
    show_notes(dict.fromkeys(n for m in metrics.values() for n in m["settings"]["notes"]))
    beside = f", side by side in {', '.join(names_drawn)}" if names_drawn else ""
    print(f"results are in the folders of {output}{beside}")
