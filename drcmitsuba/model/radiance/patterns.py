"""Patterns, textures and mixtures: constant ones count, others are refused or count as a mean."""

from __future__ import annotations

from pathlib import PurePath

import numpy as np

from drcmitsuba.model.notes import Notes
from drcmitsuba.model.radiance import expression
from drcmitsuba.model.radiance.definitions import MIXTURES, PATTERNS, TEXTURES, Definition
from drcmitsuba.model.radiance.text import Primitive

SMOOTHING = ("rev.cal", "surf.cal", "tmesh.cal")
"""Function files of textures that round the facets of a generator or a mesh."""
SMOOTHED = "Facets are flat where textures round them"
TAKEN_AS_MEAN = "Patterns and textures count as their mean of 1"
TAKEN_AS_FOREGROUND = "Mixtures count as their first material, text as its background"
_EXPRESSIONS = {"brightfunc": 1, "colorfunc": 3, "mixfunc": 1, "texfunc": 3}


def _constants(primitive: Primitive, first: int, **known: np.ndarray) -> np.ndarray | None:
    """Values of a pattern's functions where they are constant, from the string `first` on.

    They are constant but for the variables that are `known`.
    """
    count = _EXPRESSIONS.get(primitive.kind, 0)
    texts = primitive.strings[first : first + count]
    if not count or len(texts) < count:
        return None
    variables = {f"A{i}": np.float64(v) for i, v in enumerate(primitive.numbers, 1)} | known
    try:
        values = np.array([expression.value(text, variables) for text in texts], float)
    except (expression.ExpressionError, ValueError):
        return None
    return values if np.isfinite(values).all() else None


def factor(definition: Definition, means: bool, notes: Notes) -> np.ndarray:
    """Factor of red, green and blue, shape (3,), of a pattern or texture.

    Parameters
    ----------
    definition : Definition
        Pattern or texture.
    means : bool
        Whether one that is not constant counts as 1.
    notes : Notes
        Takes in what is simplified.

    Raises
    ------
    InputError
        It is not constant, and `means` is false.
    """
    primitive = definition.primitive
    kind = primitive.kind
    assert kind in (*PATTERNS, *TEXTURES)
    values = _constants(primitive, 0)
    if kind in TEXTURES:
        if values is not None and not values.any():
            return np.ones(3)
        if any(PurePath(text).name in SMOOTHING for text in primitive.strings):
            notes.add(SMOOTHED)
            return np.ones(3)
    elif values is not None and (values >= 0).all():
        return np.broadcast_to(values, 3)
    if means:
        notes.add(TAKEN_AS_MEAN, definition.name)
        return np.ones(3)
    raise primitive.error(
        "a pattern or texture that is not the same everywhere",
        "take it out, or read the model with `means`, which takes its mean as 1",
    )


def by_side(definition: Definition) -> tuple[Definition | None, Definition | None] | None:
    """Modifiers of front and back where a mixture has one on each side; None for other mixtures."""
    cosines = np.array([1.0, 0.3, 0.01, -0.01, -0.3, -1.0])  # Rdot is positive on the front
    values = _constants(definition.primitive, 2, Rdot=cosines)
    if values is None or values.shape != (1, 6) or len(definition.named) < 2:
        return None
    share, is_front = np.clip(values[0], 0, 1), cosines > 0
    first, second = definition.named[:2]
    if (share == is_front).all():
        return first, second
    return (second, first) if (share == ~is_front).all() else None


def constant_share(definition: Definition) -> float | None:
    """Share of a mixture's foreground where it is the same everywhere, within 0 and 1 [–]."""
    share = _constants(definition.primitive, 2)
    return None if share is None else float(np.clip(share[0], 0, 1))


def part(definition: Definition, means: bool, notes: Notes) -> Definition | None:
    """Modifier that stands for a mixture; None for void.

    A mixture that is constant at 1 or 0 is its foreground or its background. Arguments and error
    are those of `factor`.
    """
    primitive = definition.primitive
    assert primitive.kind in MIXTURES
    if len(definition.named) < 2:
        raise primitive.error("fewer than two materials", "name foreground and background")
    foreground, background = definition.named
    share = _constants(primitive, 2)
    if share is not None and (share[0] >= 1 or share[0] <= 0):
        return foreground if share[0] >= 1 else background
    if means:
        notes.add(TAKEN_AS_FOREGROUND, definition.name)
        return background if primitive.kind == "mixtext" else foreground
    raise primitive.error(
        "a mixture that is not the same everywhere",
        "name one material, or read the model with `means`, which takes its first",
    )
