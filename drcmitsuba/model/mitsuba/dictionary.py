"""Dictionaries, as `mi.load_dict` takes them, as entries."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from drcmitsuba.model.mitsuba.entries import DEEPEST, SceneEntries, SceneEntry, Value
from drcmitsuba.runtime.errors import InputError

REMEDY = "give numbers, texts, lists of numbers, transforms and dictionaries"


def scene_of(dictionary: Mapping[str, Any], source: Path) -> SceneEntries:
    """Entries of a dictionary of the type "scene".

    Raises
    ------
    InputError
        The dictionary has another type, or holds an object that is loaded already.
    """
    if dictionary.get("type") != "scene":
        got = f"a dictionary of type {dictionary.get('type')!r:.60}"
        raise InputError(source, "type", got, 'give one of type "scene"')
    by_id: dict[str, SceneEntry] = {}
    whole = _entry("", dictionary, source, by_id, 0)
    return SceneEntries(source, tuple(whole.children.values()), by_id)


def _entry(
    name: str, given: Mapping[str, Any], source: Path, by_id: dict[str, SceneEntry], depth: int
) -> SceneEntry:
    entry = SceneEntry(source, "", str(given.get("type", "")), str(given.get("id", name)))
    if depth > DEEPEST:
        raise entry.error("depth", f"more than {DEEPEST}", "nest less")
    for key, value in given.items():
        if key in ("type", "id"):
            continue
        if isinstance(value, Mapping):
            entry.children[key] = _entry(key, value, source, by_id, depth + 1)
        else:
            entry.values[key] = _value(entry, key, value)
    if entry.type != "ref" and depth:
        by_id[entry.id] = entry
    return entry


def _value(entry: SceneEntry, key: str, value: Any) -> Value:
    if isinstance(value, bool | str):
        return value
    if isinstance(value, Path):
        return str(value)
    try:
        made = np.array(getattr(value, "matrix", value), float)
    except (TypeError, ValueError):
        raise entry.error(key, f"a {type(value).__name__}", REMEDY) from None
    if made.size > 16 and made.ndim > 2:  # a transform of Dr.Jit's arrays
        made = made.reshape(made.shape[:2])
    return float(made) if made.ndim == 0 else made
