"""Damage to valid input: to trees of plain values, to text and to bytes; and trees as TOML."""

from __future__ import annotations

import copy
import datetime
import json
import math
import re

from hypothesis import HealthCheck, Phase
from hypothesis import strategies as st

FUZZING = {
    "deadline": None,
    "derandomize": True,
    "database": None,
    "phases": (Phase.explicit, Phase.generate, Phase.shrink),
    "suppress_health_check": list(HealthCheck),
}
"""Settings of hypothesis: the same inputs each time, however slow a reader is."""

DEEP: list = []
for _ in range(60):
    DEEP = [DEEP]

NUMBERS = (
    0, -1, 1, 2, -0.0, 0.5, -0.5, 1e-12, 1e-300, 1e9, 1e300, -1e300, math.nan, math.inf, -math.inf,
    2**31, -(2**31) - 1, 2**63, 2**64 + 1, 10**40,
)  # fmt: skip
WORDS = (
    "", " ", "0.5", "nan", "x" * 5000, "wall", "open", "glass", "ünïcödé \U0001f31e", "\u202egnp",
    "a\nb", "\x1b[31m", "\x00", "..", "../../../../../../etc/passwd", "/dev/zero", "/proc/self/mem",
    "/proc/self/maps", "/dev/full", "/", ".", "file:///etc/passwd", "http://127.0.0.1:9/x.epw",
    "%s%n{0}", "$\\frac{$", "[/red]", "03-29", "2015-03-21T10:00",
)  # fmt: skip
OTHERS = (
    True, False, [], [[]], {}, DEEP, [0.5] * 3, [0.5] * 1000, {"a": {"b": 1}}, [None],
    datetime.date(2015, 3, 21), datetime.datetime(2015, 3, 21, 10),
)  # fmt: skip

values = st.one_of(
    st.sampled_from(NUMBERS), st.sampled_from(WORDS), st.sampled_from(OTHERS).map(copy.deepcopy)
)


changes = st.sampled_from((1, 1, 1, 2, 3))


def places(tree, path=()):
    """Paths of all values in a tree of dicts and lists."""
    paths = []
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
        paths.append((*path, key))
        if isinstance(value, dict | list):
            paths += places(value, (*path, key))
    return paths


def _parent(tree, path):
    for key in path[:-1]:
        tree = tree[key]
    return tree


@st.composite
def mutated(draw, tree):
    """A copy of a tree with one to three changes of its keys and values."""
    tree = copy.deepcopy(tree)
    for _ in range(draw(changes)):
        paths = places(tree)
        if not paths:
            break
        path = draw(st.sampled_from(paths))
        parent, key = _parent(tree, path), path[-1]
        how = draw(st.sampled_from(CHANGES))
        if how == "scale" and isinstance(parent[key], int | float):
            parent[key] = parent[key] * draw(st.sampled_from([-1, 0, 1e-6, 0.01, 1.5, 3, 100]))
        elif how == "drop":
            del parent[key]
        elif how == "swap":
            other = draw(st.sampled_from(paths))
            if other[: len(path)] != path and path[: len(other)] != other:
                there = _parent(tree, other)
                parent[key], there[other[-1]] = there[other[-1]], parent[key]
        elif how == "rename" and isinstance(parent, dict):
            name = draw(st.sampled_from([f"{key}s", str(key)[:-1], str(key).upper(), *WORDS[:10]]))
            parent[name] = parent.pop(key)
        elif how == "repeat" and isinstance(parent, list):
            parent[key:key] = [parent[key]] * draw(st.sampled_from([1, 2, 300]))
        elif how == "add" and isinstance(parent, dict):
            parent[draw(st.sampled_from([*ADDED, *WORDS[:10]]))] = draw(values)
        elif how == "wrap":
            parent[key] = draw(st.sampled_from([[parent[key]], {str(key)[:20]: parent[key]}]))
        else:
            parent[key] = draw(values)
    return tree


CHANGES = ("value", "value", "value", "scale", "scale", "drop", "swap", "rename", "repeat", "add")
CHANGES += ("wrap",)
ADDED = ("type", "file", "count", "material", "seed", "tilt", "strips", "model", "size")


def toml(tree) -> str:
    """Write a tree as TOML, its tables inline."""
    return "".join(f"{_key(k)} = {_value(v)}\n" for k, v in tree.items() if v is not None)


def _key(key) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key, ensure_ascii=False)


def _value(value) -> str:
    if isinstance(value, dict):
        parts = (f"{_key(k)} = {_value(v)}" for k, v in value.items() if v is not None)
        return "{" + ", ".join(parts) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(v) for v in value if v is not None) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, datetime.date):
        return value.isoformat()
    return str(value).lower() if isinstance(value, bool) else repr(value)


NOISE = (
    "nan", "inf", "-1", "1e999", "99999999999999999999", "1e-320", "0x10", "", " ", "-", "+", "{}",
    '"', "'", "#", "\t", "\n", "\n\n", "\r\n", ",", ";", "/", "//", "<", "&x;", "é", "\x00",
    "\U0001f31e", "\ufeff", "=", "[", "]", "{", "}", "1_000", "½", "٣", "1,5", "--", "]]>", "<!--",
    "9" * 5000,
)  # fmt: skip


DIGITS = ("0", "1", "0.5", "2", "0.001", "10", "1e-30", "-1", "-0.5", "nan", "inf", "1e300", "9e18")


@st.composite
def damaged(draw, text: str):
    """Bytes of a text in which words, lines or pieces are changed, or its end is cut off."""
    for _ in range(draw(changes)):
        at = draw(st.integers(0, len(text)))
        how = draw(
            st.sampled_from(("number",) * 5 + ("word", "cut", "drop", "twice", "swap", "noise"))
        )
        if how == "cut":
            text = text[:at]
        elif how in ("drop", "twice", "swap"):
            lines = text.split("\n")
            i, j = (draw(st.integers(0, len(lines) - 1)) for _ in range(2))
            if how == "drop":
                del lines[i : i + draw(st.sampled_from([1, 2, 10]))]
            elif how == "twice":
                lines[i:i] = [lines[i]] * draw(st.sampled_from([1, 2, 50]))
            else:
                lines[i], lines[j] = lines[j], lines[i]
            text = "\n".join(lines)
        elif how == "number":
            match = re.compile(r"(?<![\w.])-?\d+(\.\d*)?").search(text, at)
            if match is not None:
                new = draw(st.sampled_from(DIGITS))
                text = text[: match.start()] + new + text[match.end() :]
        else:
            length = 0
            if how == "word":
                match = re.search(r"[^\s,;<>{}]+", text[at : at + 200])
                if match is not None:
                    at, length = at + match.start(), len(match[0])
            text = text[:at] + draw(st.sampled_from(NOISE)) + text[at + length :]
    if draw(st.integers(0, 9)):
        return text.encode("utf-8", "replace")
    raw = text.encode("utf-8", "replace")
    at = draw(st.integers(0, len(raw)))
    return raw[:at] + draw(st.binary(max_size=8)) + raw[at + draw(st.integers(0, 8)) :]
