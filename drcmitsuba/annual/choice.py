"""A choice of fills for the openings of a case, and the groups that move beside it.

A choice maps an opening to a fill, to shares of fills that add up to one, or to either by the hour.
Openings that it does not name stay as in the case: by the rule of the shade, or by their schedules.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from drcmitsuba.case.groups import OPEN
from drcmitsuba.runtime.content_key import content_key
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import choose, shortened

Choice = Mapping[str, str | Mapping[str, float] | xr.DataArray]
"""Fill by opening: its name, shares by name, or a DataArray over `time`, with a dim `fill` where it
holds shares instead of names."""
WHOLE = 1e-6
"""Largest difference from 1 that shares of an opening may add up to."""
MOST_MIXTURES = 200
"""Largest number of different shares that an opening takes in a year."""


@dataclass(frozen=True, eq=False)
class Mixtures:
    """Shares of the fills of an opening by the hour."""

    shares: np.ndarray
    """Different shares that occur, those of the first fill alone first, (mixture, fill)."""
    index: np.ndarray
    """Mixture of every time stamp, int, shape (time,)."""
    names: tuple[str, ...]
    """Names of the mixtures, "open" first."""

    @classmethod
    def of(cls, opening: str, fills: tuple[str, ...], shares: np.ndarray) -> Mixtures:
        """Tell the shares (time, fill) of an opening apart."""
        first = np.eye(1, len(fills), dtype=np.float32)
        rows, index = np.unique(np.concatenate([first, shares]), axis=0, return_inverse=True)
        if len(rows) > MOST_MIXTURES:
            got = f"{len(rows)} different shares of its fills in a year"
            remedy = f"round them: at most {MOST_MIXTURES} are told apart"
            raise InputError("choice", opening, got, remedy)
        order = np.append(index[0], np.setdiff1d(np.arange(len(rows)), index[0]))
        place = np.argsort(order)
        return cls(rows[order], place[index[1:]], (OPEN, *_named(rows[order[1:]], fills)))


def _named(mixtures: np.ndarray, fills: tuple[str, ...]) -> list[str]:
    """Names of shares (mixture, fill), each once and without slashes."""
    names: list[str] = []
    for i, row in enumerate(mixtures, 1):
        some = np.flatnonzero(row)
        whole = row[some[0]] == 1
        parts = (f"{row[k]:.2g} {fills[k]}" for k in some)
        name = (fills[some[0]] if whole else " + ".join(parts)).replace("/", "-")
        names.append(f"{name} {i}" if name in (OPEN, *names) else name)
    return names


@dataclass(frozen=True, eq=False)
class ChosenFills:
    """Fills that a choice gives to openings."""

    constant: Mapping[int, np.ndarray]
    """Shares (fill,) of openings, by their index."""
    hourly: Mapping[int, Mixtures]
    """Shares by the hour, likewise."""

    @classmethod
    def of(
        cls, fills_of: Mapping[str, tuple[str, ...]], choice: Choice, time: np.ndarray
    ) -> ChosenFills:
        """Check a choice for time stamps; `fills_of` names the fills of every opening.

        Raises
        ------
        InputError
            An opening or a fill is unknown, shares do not add up to one, or a time stamp is
            missing.
        """
        if not isinstance(choice, Mapping):
            got = shortened(str(choice))
            raise InputError("choice", "opening", got, "give a mapping from openings to fills")
        constant, hourly, names = {}, {}, [*fills_of]
        for opening, given in choice.items():
            if opening not in fills_of:
                got = f"no opening {shortened(str(opening))}"
                raise InputError("choice", "opening", got, choose(str(opening), names))
            g, fills = names.index(opening), fills_of[opening]
            if isinstance(given, xr.DataArray):
                hourly[g] = Mixtures.of(opening, fills, _by_hour(opening, fills, given, time))
            else:
                shares = {given: 1.0} if isinstance(given, str) else given
                constant[g] = _row(opening, fills, shares)
        return cls(constant, hourly)

    def in_words(self, fills_of: Mapping[str, tuple[str, ...]]) -> str:
        """Text of the choice: "south: blind; east: 0.4 glass + 0.6 hole"."""
        words, names = [], [*fills_of]
        for g, row in self.constant.items():
            some = [(float(row[k]), fills_of[names[g]][k]) for k in np.flatnonzero(row)]
            shares = (name if share == 1 else f"{share:.4g} {name}" for share, name in some)
            words.append(f"{names[g]}: {' + '.join(shares)}")
        for g, mixtures in self.hourly.items():
            key = content_key(mixtures.shares[mixtures.index])[:8]
            words.append(f"{names[g]}: by the hour ({key})")
        return "; ".join(words)

    @property
    def named(self) -> set[int]:
        """Openings that the choice names."""
        return {*self.constant, *self.hourly}


def _row(opening: str, fills: tuple[str, ...], shares: Mapping[str, float]) -> np.ndarray:
    """Shares (fill,) from shares by name."""
    if not isinstance(shares, Mapping):
        got, remedy = type(shares).__name__, "give a fill, shares by fill, or a DataArray over time"
        raise InputError("choice", opening, got, remedy)
    row = np.zeros(len(fills), np.float32)
    for name, share in shares.items():
        if isinstance(share, str | Sequence) or np.asarray(share).dtype.kind not in "biuf":
            got = f"the share {shortened(str(share))} of {shortened(str(name))}"
            raise InputError("choice", opening, got, "give a number from 0 to 1")
        row[_index(opening, fills, name)] += float(share)
    return _checked(opening, row[None])[0]


def _by_hour(
    opening: str, fills: tuple[str, ...], given: xr.DataArray, time: np.ndarray
) -> np.ndarray:
    """Shares (time, fill) from an array over `time`."""
    if "time" not in given.dims or not set(given.dims) <= {"time", "fill"}:
        got = f"an array with dims {', '.join(map(str, given.dims)) or 'of none'}"
        raise InputError("choice", opening, got, "give the dim time, and fill for shares")
    if "fill" in given.dims and given.dtype.kind not in "iuf":
        raise InputError("choice", opening, f"shares of type {given.dtype}", "give numbers")
    if "fill" not in given.coords and given.sizes.get("fill", len(fills)) != len(fills):
        got = f"{given.sizes['fill']} shares without names, of {len(fills)} fills"
        raise InputError("choice", opening, got, "give the coordinate fill")
    if "time" in given.coords:
        if given["time"].dtype.kind != "M":
            got = f"time stamps of type {given['time'].dtype}"
            raise InputError("choice", opening, got, "give them as datetime64, local standard time")
        given = given.sortby("time")
        known = given["time"].values
        if (twice := known[1:] == known[:-1]).any():
            stamp = str(known[1:][np.argmax(twice)])[:16]
            raise InputError("choice", opening, f"two fills at {stamp}", "name one")
    elif given.sizes["time"] == len(time):
        known = time
    else:
        got = f"{given.sizes['time']} entries without time stamps, the period has {len(time)}"
        raise InputError("choice", opening, got, "give the coordinate time")
    if not len(known):
        raise InputError("choice", opening, "an array without time stamps", "name a fill for each")
    at = np.minimum(np.searchsorted(known, time), len(known) - 1)
    values = given.transpose("time", ...).values[at]
    missing = (known[at] != time) | pd.isnull(values).reshape(len(time), -1).any(axis=1)
    if missing.any():
        stamp = np.datetime_as_string(time[np.argmax(missing)], unit="m")
        got, remedy = f"no fill at {stamp}", "name one for every time stamp"
        raise InputError("choice", opening, got, remedy)
    out = np.zeros((len(time), len(fills)), np.float32)
    if "fill" not in given.dims:
        for name in dict.fromkeys(values.tolist()):
            out[values == name, _index(opening, fills, name)] = 1
        return out
    names = given["fill"].values if "fill" in given.coords else range(len(fills))
    columns = [_index(opening, fills, name) for name in names]
    if len(set(columns)) < len(columns):
        raise InputError("choice", opening, "a fill that comes twice", "name each fill once")
    out[:, columns] = values
    return _checked(opening, out)


def _index(opening: str, fills: tuple[str, ...], name: Any) -> int:
    """Index of a fill by its name, or by its number; "open" stands for the first one."""
    is_number = isinstance(name, int | np.integer) and not isinstance(name, bool)
    if is_number and 0 <= name < len(fills):
        return int(name)
    if name == OPEN:
        return 0
    if str(name) not in fills:
        got = f"no fill {shortened(str(name))} of {shortened(opening)}"
        raise InputError("choice", opening, got, choose(str(name), fills))
    return fills.index(str(name))


def _checked(opening: str, shares: np.ndarray) -> np.ndarray:
    """Shares (…, fill) that are no less than 0 and add up to 1."""
    total = shares.sum(axis=1)
    wrong = ~(abs(total - 1) <= WHOLE) | ~(shares >= 0).all(axis=1)
    if wrong.any():
        row = shares[int(np.argmax(wrong))]
        got = f"shares {', '.join(f'{v:g}' for v in row)}, {row.sum():g} together"
        raise InputError("choice", opening, got, "give shares from 0 that add up to 1")
    return shares
