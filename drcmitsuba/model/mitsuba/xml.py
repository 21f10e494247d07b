"""Mitsuba XML as entries. No plugin is loaded; `$name` stands for the value of a `<default>`."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

import numpy as np
from defusedxml import ElementTree
from defusedxml.common import DefusedXmlException

from drcmitsuba.model.mesh.part import beside
from drcmitsuba.model.mitsuba.entries import (
    DEEPEST,
    IDENTITY,
    MOST_ENTRIES,
    SceneEntries,
    SceneEntry,
    Value,
)
from drcmitsuba.model.source_file import read_bytes
from drcmitsuba.runtime.errors import InputError

LARGEST = 8 * 2**20
"""Largest file that is read, and all files that it includes together [B]."""
MOST_FILES = 100
"""Largest number of files of a scene."""
PLUGINS = (
    "shape", "bsdf", "texture", "emitter", "sensor", "integrator", "medium", "film", "sampler",
    "rfilter", "phase", "volume", "spectrum", "ref",
)  # fmt: skip
"""Elements that are plugins or references to one."""


class _Reading:
    """Files that are read, with their defaults and named entries."""

    def __init__(self) -> None:
        self.defaults: dict[str, str] = {}
        self.by_id: dict[str, SceneEntry] = {}
        self.entries: list[SceneEntry] = []
        self.bytes, self.files, self.count = LARGEST, MOST_FILES, 0

    def read(self, file: Path, depth: int = 0) -> None:
        """Read a file and those that it includes."""
        self.files -= 1
        if self.files < 0 or depth > DEEPEST:
            got = "too many files that include others"
            raise InputError(file, "include", got, "join them into one")
        raw = read_bytes(file, self.bytes)
        self.bytes -= len(raw)
        remedy = "give a scene as Mitsuba writes it"
        try:
            root = ElementTree.fromstring(raw, forbid_dtd=True)
        except (ParseError, DefusedXmlException, ValueError, LookupError) as error:
            got = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
            raise InputError(file, "XML", got, remedy) from None
        if root.tag != "scene":
            raise InputError(file, "XML", f"a <{root.tag:.40}>, no <scene>", remedy)
        for element in root:
            self._statement(file, element, depth)

    def _statement(self, file: Path, element: Element, depth: int) -> None:
        tag = element.tag
        if tag == "default":
            self.defaults.setdefault(element.get("name", ""), element.get("value", ""))
        elif tag == "include":
            name = self._text(file, element, "filename")
            path = beside(file, name)
            if path is None:
                raise InputError(file, "include", f"{name:.80}", "put it beside the file")
            self.read(path, depth + 1)
        elif tag == "alias":
            made = self.by_id.get(element.get("id", ""))
            if made is None:
                got = f"{element.get('id')!r:.60}, which is not defined before"
                raise InputError(file, "alias", got, "define it first")
            self.by_id[element.get("as", "")] = made
        elif tag in PLUGINS:
            self.entries.append(self._entry(file, element, 0))
        else:
            got = f"<{tag:.40}>"
            raise InputError(file, "scene", got, "leave it out: shapes and BSDFs are read")

    def _entry(self, file: Path, element: Element, depth: int) -> SceneEntry:
        """Entry of an element, with those within it."""
        self.count += 1
        if self.count > MOST_ENTRIES or depth > DEEPEST:
            got = f"more than {MOST_ENTRIES} entries, or {DEEPEST} in one another"
            raise InputError(file, "scene", got, "leave out what no daylight meets")
        kind = element.tag
        plugin = "ref" if kind == "ref" else self._text(file, element, "type")
        entry = SceneEntry(file, kind, plugin, self._text(file, element, "id"))
        if kind == "spectrum" and element.get("value") is not None:
            entry.type, entry.values["value"] = "spectrum", self._value(file, element)
        for i, inner in enumerate(element):
            name = self._text(file, inner, "name")
            if inner.tag == "spectrum" and inner.get("value") is not None:
                entry.values[name] = self._value(file, inner)
            elif inner.tag in PLUGINS:
                entry.children[name or str(i)] = self._entry(file, inner, depth + 1)
            elif inner.tag in _VALUES:
                entry.values[name] = self._value(file, inner)
            else:
                raise entry.error("element", f"<{inner.tag:.40}>", "leave it out")
        if entry.id and kind != "ref":
            self.by_id[entry.id] = entry
        return entry

    def _text(self, file: Path, element: Element, name: str) -> str:
        """Attribute with its `$name` replaced."""

        def value(found: re.Match[str]) -> str:
            if found.group(1) not in self.defaults:
                got = f"${found.group(1):.40} without a <default>"
                raise InputError(file, element.tag, got, "give it one")
            return self.defaults[found.group(1)]

        return re.sub(r"\$(\w{1,64})", value, element.get(name, "")[:100_000])

    def _value(self, file: Path, element: Element) -> Value:
        try:
            return _VALUES[element.tag](lambda of, name: self._text(file, of, name), element)
        except (ValueError, OverflowError) as error:
            name = element.get("name", "")
            field, got = f"{element.tag} {name!r:.60}", f"{error}"[:120]
            raise InputError(file, field, got, "correct it") from None


Attribute = Callable[[Element, str], str]
"""Gives an attribute of an element, "" where there is none."""


def _numbers(text: str) -> np.ndarray:
    """Numbers that commas or spaces separate."""
    return np.array([float(word) for word in re.split(r"[,\s]+", text.strip())])


def _boolean(get: Attribute, element: Element) -> bool:
    word = get(element, "value").strip().lower()
    if word not in ("true", "false"):
        raise ValueError(f"{word!r:.40}, neither true nor false")
    return word == "true"


def _colour(get: Attribute, element: Element) -> Value:
    text = get(element, "value").strip()
    if re.fullmatch(r"#[0-9a-fA-F]{6}", text):
        srgb = np.array([int(text[i : i + 2], 16) / 255 for i in (1, 3, 5)])
        return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    if ":" in text:
        raise ValueError("values over the wavelength; give red, green and blue")
    values = _numbers(text)
    if values.shape not in ((1,), (3,)):
        raise ValueError(f"{len(values)} numbers for a colour")
    return values if len(values) == 3 else float(values[0])


def _point(get: Attribute, element: Element) -> np.ndarray:
    text = get(element, "value") or " ".join(get(element, axis) or "0" for axis in "xyz")
    values = _numbers(text)
    if values.shape != (3,):
        raise ValueError(f"{len(values)} numbers for a point")
    return values


def _transform(get: Attribute, element: Element) -> np.ndarray:
    """Product of moves, the first one applied first."""
    whole = IDENTITY
    for step in list(element)[:1000]:
        whole = _move(get, step) @ whole
    return whole


def _move(get: Attribute, step: Element) -> np.ndarray:
    """One step of a transform (4, 4)."""
    made, tag = np.eye(4), step.tag
    if tag == "matrix":
        values = _numbers(get(step, "value"))
        size = {16: 4, 9: 3}.get(len(values))
        if size is None:
            raise ValueError(f"a matrix of {len(values)} numbers")
        made[:size, :size] = values.reshape(size, size)
        return made
    if tag == "lookat":
        at, target, up = (_numbers(get(step, n)) for n in ("origin", "target", "up"))
        if not at.shape == target.shape == up.shape == (3,):
            raise ValueError("a lookat without three points")
        made[:3, 2] = _unit(target - at)
        made[:3, 0] = _unit(np.cross(up, made[:3, 2]))
        made[:3, 1], made[:3, 3] = np.cross(made[:3, 2], made[:3, 0]), at
        return made
    default = "1" if tag == "scale" else "0"
    text = get(step, "value") or " ".join(get(step, axis) or default for axis in "xyz")
    values = _numbers(text)
    if tag == "scale":
        made[:3, :3] = np.diag(np.broadcast_to(values, 3))
    elif tag == "translate":
        made[:3, 3] = values
    elif tag == "rotate":
        angle, (x, y, z) = np.radians(float(get(step, "angle") or "0")), _unit(values)
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        made[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    else:
        raise ValueError(f"the move <{tag:.40}>")
    return made


def _unit(vector: np.ndarray) -> np.ndarray:
    length = float(np.linalg.norm(vector))
    if not 0 < length < np.inf:
        raise ValueError("a direction without length")
    return vector / length


def _number(get: Attribute, element: Element) -> float:
    return float(get(element, "value"))


_VALUES: dict[str, Callable[[Attribute, Element], Value]] = {
    "float": _number,
    "integer": _number,
    "string": lambda get, element: get(element, "value"),
    "boolean": _boolean,
    **dict.fromkeys(("rgb", "spectrum"), _colour),
    **dict.fromkeys(("point", "vector"), _point),
    "transform": _transform,
}
"""Elements that are values."""


def scene_of(file: Path) -> SceneEntries:
    """Entries of an XML file.

    Raises
    ------
    InputError
        The file, or one that it includes, is missing, too large, or no Mitsuba scene.
    """
    reading = _Reading()
    reading.read(file)
    return SceneEntries(file, tuple(reading.entries), reading.by_id)
