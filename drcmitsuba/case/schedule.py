"""Schedules of groups of panes: a state for every hour of the year, from CSV."""

from __future__ import annotations

import base64
import csv
import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.case.groups import Group, GroupStates
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import choose, shortened

HOURS = 8760
MAX_BYTES = 8 << 20
"""Largest size of a schedule [bytes]."""


@dataclass(frozen=True)
class Schedule:
    """States of scheduled groups in the hours of a year of 365 days, in local standard time."""

    of_group: Mapping[int, np.ndarray] = field(default_factory=dict)
    """Index of the state in every hour, int, shape (8760,), by the index of the group."""
    groups: int = 1

    @classmethod
    def of_attributes(cls, attributes: Mapping[str, Any], groups: GroupStates) -> Schedule:
        """Read the attribute `schedule` of C or E; an empty schedule without it."""
        try:
            table = json.loads(attributes.get("schedule", "{}"))
            of_group = {int(k): _unpacked(v) for k, v in table.items()}
            fits = all(
                v.shape == (HOURS,) and v.max() <= groups.last[k] for k, v in of_group.items()
            )
        except (ValueError, TypeError, AttributeError, IndexError, zlib.error):
            fits = False
        if not fits:
            got = "no state for every hour of the year"
            raise InputError("coefficients", "schedule", got, "compute them anew")
        return cls(of_group, len(groups))

    def attributes(self) -> dict[str, str]:
        """Attribute `schedule`, compressed for files; none without scheduled groups."""
        table = {
            str(k): base64.b64encode(zlib.compress(v.astype("<u2").tobytes())).decode()
            for k, v in self.of_group.items()
        }
        return {"schedule": json.dumps(table)} if table else {}

    @property
    def given(self) -> np.ndarray:
        """Whether each group follows a schedule, bool, shape (group,)."""
        return np.isin(np.arange(self.groups), list(self.of_group))

    def indices(self, time: xr.DataArray) -> np.ndarray:
        """Index of the state of every group at time stamps, int, (time, group); 0 without one.

        29 February takes the states of 28 February.
        """
        hour = hour_of_year(time)
        out = np.zeros((len(hour), self.groups), np.int16)
        for group, states in self.of_group.items():
            out[:, group] = states[hour]
        return out


def hour_of_year(time: xr.DataArray) -> np.ndarray:
    """Hour of a year of 365 days that holds each time stamp, int, (time,).

    29 February counts as 28 February.
    """
    months, days = time.dt.month.values, time.dt.day.values
    day = _FIRST_DAY[months - 1] + np.where((months == 2) & (days == 29), 28, days) - 1
    return np.asarray(24 * day + time.dt.hour.values)


def schedule_of(groups: Mapping[str, Group], states: GroupStates) -> Schedule:
    """Read the schedules of the groups of a case; `states` are those of all its groups.

    Raises
    ------
    InputError
        As `read_schedule`.
    """
    of_group = {
        states.names.index(name): read_schedule(group.schedule, name, states.states[i])
        for i, (name, group) in enumerate(groups.items())
        if group.schedule is not None
    }
    return Schedule(of_group, len(states))


def _unpacked(text: str) -> np.ndarray:
    """States of a group from the attribute; a longer text than any year has is cut off."""
    packed = base64.b64decode(text, validate=True)
    return np.frombuffer(zlib.decompressobj().decompress(packed, 2 * HOURS + 2), "<u2")


_FIRST_DAY = np.cumsum([0, 31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30])


def read_schedule(file: Path, group: str, states: tuple[str, ...]) -> np.ndarray:
    """Read the states of a group from CSV.

    Parameters
    ----------
    file : Path
        A head with names of groups, then a line for each hour of the year, the first from 0:00 to
        1:00 on 1 January.
    group : str
        Name of the column.
    states : tuple of str
        Names of the states; their numbers, from 0, may stand in the file, too.

    Returns
    -------
    np.ndarray of int, shape (8760,)

    Raises
    ------
    InputError
        The file has no such column, another number of lines, or an unknown state.
    """
    if file.stat().st_size > MAX_BYTES:
        got = f"{file.stat().st_size >> 20} MiB"
        raise InputError(file, "size", got, "give one line for every hour of the year")
    text = file.read_text(encoding="utf-8-sig", errors="replace")
    try:
        reader = csv.reader(text.splitlines())
        rows = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise InputError(file, "line", str(error), "write plain CSV") from None
    head = [cell.strip() for cell in rows[0][1]] if rows else []
    if group not in head:
        got = f"no column {shortened(group)}"
        raise InputError(file, "head", got, choose(group, head, "name the group in the first line"))
    if head.count(group) > 1:
        got = f"{head.count(group)} columns {shortened(group)}"
        raise InputError(file, "head", got, "give each group one column")
    if len(rows) - 1 != HOURS:
        remedy = f"give {HOURS}, one for every hour of the year"
        raise InputError(file, "lines", f"{len(rows) - 1} below the head", remedy)
    column = head.index(group)
    number = {name: i for i, name in enumerate(states)}
    number |= {str(i): i for i in range(len(states)) if str(i) not in number}
    out = np.empty(HOURS, np.int16)
    for hour, (line, row) in enumerate(rows[1:]):
        name = row[column].strip() if column < len(row) else ""
        if name not in number:
            place = f"line {line}, {group}"
            raise InputError(file, place, shortened(name), choose(name, states))
        out[hour] = number[name]
    return out
