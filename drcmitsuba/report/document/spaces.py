"""Table of spaces, storeys and the building; of grids where a façade tells no spaces apart."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.metrics.metrics_of_spaces import darkest_first
from drcmitsuba.report.document.facade import EvaluatedFacade
from drcmitsuba.report.document.labels import labels
from drcmitsuba.report.document.table import NONE, Cell, Number, PageTable, interval, plain

ENDS = ("value", "low", "high")
"""Numbers of a share."""
MOST_ROWS = 40
"""Largest number of spaces of a façade in the table."""
COLUMNS = (
    "space", "use", "storey", "floor_area", "point_count", "sDA", "ASE", "target", "DA",
    "electric_light",
)  # fmt: skip


def table(facade: EvaluatedFacade, name: str) -> PageTable | None:
    """Table of the spaces of one façade, those with least daylight first, of its storeys, and of
    the building by area; of its grids where it tells no spaces apart, and None without grids.
    """
    t, grids = labels(), facade.numbers.get("grids", {})
    told, whole = told_rows(facade.numbers, "spaces"), told_rows(facade.numbers, "building")
    if len(told) > 1 and whole:
        building = {**whole[0], "name": t["by_area"]}
        worst = darkest_first(told)
        rooms = [*worst[:MOST_ROWS], *_storeys(facade.numbers, len(told)), building]
        notes = [t["tasks_note"]] if any("DA" in room for room in rooms) else []
        left = len(told) - MOST_ROWS
        notes += [t["more_spaces"].format(count=left)] if left > 0 else []
        head = tuple(t[n] for n in COLUMNS)
        return PageTable(name, head, tuple(map(_space, rooms)), " ".join(notes))
    if not grids:
        return None
    rows: list[tuple[Cell, ...]] = []
    sizes = {n: len(sensors) for n, sensors in sensors_by_grid(facade.illuminance).items()}
    for grid, numbers in list(grids.items())[:MOST_ROWS]:
        shares = (interval(numbers[metric]) for metric in ("sDA", "ASE"))
        rows.append((plain(grid), plain(sizes.get(grid, NONE)), *shares))
    left = len(grids) - MOST_ROWS
    note = t["more_spaces"].format(count=left) if left > 0 else ""
    return PageTable(name, (t["space"], t["point_count"], t["sDA"], t["ASE"]), tuple(rows), note)


def _storeys(numbers: Mapping[str, Any], spaces: int) -> list[Mapping[str, Any]]:
    """Rows of the storeys; none where each has one space."""
    told = told_rows(numbers, "storeys")
    if len(told) >= spaces:
        return []
    all_spaces = labels()["all_spaces"]
    return [{**storey, "storey": storey["name"], "name": all_spaces} for storey in told]


def told_rows(numbers: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    """Spaces, storeys, or the building of `metrics.json`; none where the file was damaged.

    Parts of a task (target, DA, electric light) that are missing or damaged are left out.
    """
    told = numbers.get(key)
    rows: list[Any] = told if isinstance(told, list) else [told]
    return [*map(_with_sound_task, rows)] if all(map(_is_row, rows)) else []


def numbers_of_task(row: Mapping[str, Any]) -> list[tuple[str, list[float], str]]:
    """Name, numbers and unit of what a row from `told_rows` says on its task."""
    out = [("DA", _numbers(row["DA"]), "%")] if "DA" in row else []
    for name, value in row.get("electric_light", {}).items():
        numbers = [value] if name == "hours" else _numbers(value)
        out.append((f"electric light, {name}", numbers, "kWh" if name == "energy" else "h"))
    return out


def _numbers(number: Mapping[str, float]) -> list[float]:
    return [number[end] for end in ENDS]


def _is_row(row: object) -> bool:
    """Whether an entry has an area, a number of sensors, and shares with their intervals."""
    if not isinstance(row, dict):
        return False
    has_shares = all(_is_share(row.get(name)) for name in ("sDA", "ASE"))
    is_named = all(isinstance(row.get(key, ""), str) for key in ("name", "use", "storey"))
    has_size = all(_is_number(row.get(key)) for key in ("floor_area", "sensors"))
    return has_shares and is_named and has_size


def _with_sound_task(row: dict[str, Any]) -> Mapping[str, Any]:
    light, target = row.get("electric_light"), row.get("target")
    sound = {
        "DA": _is_share(row.get("DA")),
        "target": _is_number(target),
        "electric_light": isinstance(light, dict)
        and _is_number(light.get("hours"))
        and all(_is_share(value) for name, value in light.items() if name != "hours"),
    }
    return {key: value for key, value in row.items() if sound.get(key, True)}


def _is_share(value: object) -> bool:
    return isinstance(value, dict) and all(_is_number(value.get(end)) for end in ENDS)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _space(space: Mapping[str, Any]) -> tuple[Cell, ...]:
    """Row of a space, a storey, or the building."""
    words = (plain(space.get(key) or NONE) for key in ("name", "use", "storey"))
    shares = (interval(space[metric]) for metric in ("sDA", "ASE"))
    area = (Number(float(space["floor_area"]), 1), " m²")
    return (*words, area, plain(space["sensors"]), *shares, *_task(space))


def _task(space: Mapping[str, Any]) -> tuple[Cell, Cell, Cell]:
    """Target with its hours, autonomy at it, and full hours of the lamps with their energy."""
    hours, light = space.get("hours"), space.get("electric_light", {})
    target: Cell = (Number(space["target"], 0), " lx") if "target" in space else (NONE,)
    if target != (NONE,) and isinstance(hours, list) and len(hours) == 2:
        target = (*target, *plain(f", {hours[0]}–{hours[1]} h"))
    lamps: Cell = (NONE,)
    if "hours_saved" in light:
        value, low, high = (light["hours"] - n for n in _numbers(light["hours_saved"]))
        lamps = interval({"value": value, "low": high, "high": low}, "h", 0)
    if "energy" in light:
        lamps = (*lamps, ", ", *interval(light["energy"], "kWh", 0))
    return target, interval(space.get("DA")), lamps
