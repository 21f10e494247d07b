"""Entries of a Mitsuba scene, from XML or a dictionary, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drcmitsuba.model.materials import Reflectance
from drcmitsuba.runtime.errors import InputError

FARTHEST = 1e9
"""Largest magnitude of a number [units of the file]."""
MOST_ENTRIES = 200_000
"""Largest number of entries of a scene."""
DEEPEST = 16
"""Largest depth of entries in one another."""
IDENTITY = np.eye(4)
Value = float | str | bool | np.ndarray
"""Number, text, choice, colour (3,), point (3,) or transform (4, 4)."""


@dataclass(eq=False)
class SceneEntry:
    """Shape, BSDF, texture or another plugin of a scene, or a reference to one."""

    source: Path
    """File or name of the scene, for messages."""
    kind: str
    """Name of the XML element: shape, bsdf, texture, ref, …; "" in a dictionary."""
    type: str
    """Name of the plugin."""
    id: str = ""
    values: dict[str, Value] = field(default_factory=dict)
    children: dict[str, SceneEntry] = field(default_factory=dict)
    """Entries within this one by name; nameless ones have a number."""

    def error(self, field: str, got: str, remedy: str) -> InputError:
        """Error that names the file and the entry."""
        where = f"{self.kind or 'entry'} {self.id or self.type!r}"
        return InputError(self.source, f"{where}: {field}", got, remedy)

    def number(self, name: str, default: float) -> float:
        """Value as a number; a colour of one plugin is refused."""
        value = self.values.get(name, default)
        if isinstance(value, bool | str | np.ndarray) or not abs(value) <= FARTHEST:
            raise self.error(name, f"{value!r:.60}", "give a number")
        return float(value)

    def flag(self, name: str) -> bool:
        """Value as a choice, false by default."""
        value = self.values.get(name, False)
        if not isinstance(value, bool):
            raise self.error(name, f"{value!r:.60}", "give true or false")
        return value

    def text(self, name: str) -> str:
        """Value as a text, empty by default."""
        value = self.values.get(name, "")
        if not isinstance(value, str):
            raise self.error(name, f"{value!r:.60}", "give a text")
        return value

    def point(self, name: str, default: tuple[float, float, float]) -> np.ndarray:
        """Value as a point (3,)."""
        value = np.asarray(self.values.get(name, default))
        if value.shape != (3,) or value.dtype.kind != "f" or not np.abs(value).max() <= FARTHEST:
            raise self.error(name, f"{self.values.get(name)!r:.60}", "give three numbers")
        return value

    def transform(self) -> np.ndarray:
        """`to_world` (4, 4), the identity by default."""
        value = self.values.get("to_world", IDENTITY)
        remedy = "give a transform that keeps lengths above 0"
        if not isinstance(value, np.ndarray) or value.shape != (4, 4):
            raise self.error("to_world", f"{value!r:.60}", remedy)
        if not np.abs(value).max() <= FARTHEST or (value[3] != IDENTITY[3]).any():
            raise self.error("to_world", "numbers that are no affine transform", remedy)
        return value

    def reflectance(self, name: str, default: float) -> Reflectance:
        """Value as a reflectance [–]: one number, a colour, or a plugin of one of them."""
        value: object = self.values.get(name, default)
        inner = self.children.get(name)
        if inner is not None:
            if inner.type not in ("rgb", "srgb", "uniform", "spectrum", "d65"):
                got = f"a texture ({inner.type})"
                raise self.error(name, got, "give the mean in [model.reflectances]")
            value = inner.values.get("value", inner.values.get("color", default))
        remedy = "give one number or three of 0 to 1"
        if isinstance(value, bool | str):
            raise self.error(name, f"{value!r:.60}", remedy)
        channels = np.atleast_1d(np.asarray(value, float))
        if channels.shape not in ((1,), (3,)) or not ((channels >= 0) & (channels <= 1)).all():
            raise self.error(name, f"{np.ravel(channels)[:4].tolist()}", remedy)
        if np.ptp(channels) == 0:
            return float(channels[0])
        red, green, blue = channels.tolist()
        return red, green, blue


@dataclass(frozen=True)
class SceneEntries:
    """Entries of a scene, and those that references name."""

    source: Path
    entries: tuple[SceneEntry, ...]
    by_id: Mapping[str, SceneEntry]

    def resolved(self, entry: SceneEntry) -> SceneEntry:
        """Entry itself, or the one to which a reference points.

        Raises
        ------
        InputError
            There is no such entry, or references form a circle.
        """
        for _ in range(DEEPEST):
            if entry.type != "ref":
                return entry
            name = entry.id
            if name not in self.by_id:
                raise entry.error("id", "nothing has it", "define it in the scene")
            entry = self.by_id[name]
        raise entry.error("id", "a circle of references", "refer to an entry of its own")
