"""Tables for the record: what was simulated and why, with what, and how it was validated."""

from __future__ import annotations

import platform
from importlib import metadata, resources

from drcmitsuba.report.document.facade import EvaluatedFacade
from drcmitsuba.report.document.labels import labels
from drcmitsuba.report.document.table import (
    NONE,
    Cell,
    Number,
    PageTable,
    in_columns,
    plain,
    share,
    text,
)
from drcmitsuba.runtime.toml import tomllib

PACKAGES = ("drcmitsuba", "mitsuba", "drjit", "numpy")
MOST_NOTES = 50
"""Largest number of notes of a façade."""
OF_ACCURACY = ("seed", "replicates", "paths", "cell_size", "photons")
"""Settings of the sampling that are shown."""


def plan(facade: EvaluatedFacade, name: str) -> PageTable | None:
    """Table of the effects that were simulated, and why; None without `plan.json`."""
    t = labels()
    rows = tuple(
        (
            plain(effect), (t["yes"] if entry.get("on") is True else t["no"],),
            plain(entry.get("reason", NONE)), (share(entry.get("share")),),
        )
        for effect, entry in facade.plan.items() if effect != "cost"
    )  # fmt: skip
    if not rows:
        return None
    cost = facade.plan.get("cost", {}).get("reason")
    note = f"{t['cost']}: {text(cost)}" if cost else ""
    return PageTable(name, (t["effect"], t["simulated"], t["reason"], t["share"]), rows, note)


def versions(facades: list[EvaluatedFacade], names: list[str]) -> PageTable:
    """Table of versions, sampling and time."""
    t = labels()
    rows: dict[str, list[Cell]] = {
        t["version"]: [plain(f.illuminance.attrs.get("version", NONE)) for f in facades],
        t["variant"]: [plain(f.settings.get("variant", NONE)) for f in facades],
        t["fingerprint"]: [plain(f.fingerprint or NONE) for f in facades],
        t["seconds"]: [_seconds(f) for f in facades],
        t["memory"]: [_memory(f) for f in facades],
    }
    for key in OF_ACCURACY:
        rows[f"accuracy.{key}"] = [plain(getattr(f.case.accuracy, key, NONE)) for f in facades]
    made = ", ".join(f"{name} {metadata.version(name)}" for name in PACKAGES)
    note = t["made_by"].format(versions=f"{made}, Python {platform.python_version()}")
    return in_columns(t["versions"], t["what"], names, rows, note)


def _seconds(facade: EvaluatedFacade) -> Cell:
    seconds = facade.numbers.get("seconds", {})
    values = seconds.values() if isinstance(seconds, dict) else ()
    known = [v for v in values if isinstance(v, int | float) and abs(v) < 1e12]
    return (Number(sum(known)), " s") if known else (NONE,)


def _memory(facade: EvaluatedFacade) -> Cell:
    size = facade.numbers.get("peak_memory_bytes")
    known = isinstance(size, int) and 0 <= size < 1 << 60
    return (Number(size / (1 << 30), 2), " GiB") if known else (NONE,)  # type: ignore[operator]


def notes(facade: EvaluatedFacade) -> list[str]:
    """Notes on a result, and on what the report cannot show."""
    told = facade.settings.get("notes", [])
    every = [*facade.notes, *(told if isinstance(told, list) else ())]
    return [text(note) for note in every[:MOST_NOTES]]


def validation() -> PageTable:
    """Table of what the program was compared with."""
    t = labels()
    file = resources.files(__package__).joinpath("validation.toml")
    rows = tomllib.loads(file.read_text(encoding="utf-8"))["rows"]
    cells = tuple(
        tuple(plain(row[key]) for key in ("ours", "against", "agreement")) for row in rows
    )
    head = (t["ours"], t["against"], t["agreement"])
    return PageTable(t["validation"], head, cells, t["validation_note"])
