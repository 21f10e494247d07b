"""Words of a generator's command line: options, numbers, and errors that name its form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drcmitsuba.model.radiance.text import FileLine, Primitive, is_number
from drcmitsuba.runtime.errors import InputError

LARGEST = 1e12
"""Largest magnitude of a number [m]."""


@dataclass(frozen=True)
class Usage:
    """Form of a command and its line."""

    form: str
    place: FileLine

    def error(self, got: str) -> InputError:
        """Error that states the form."""
        return self.place.error(self.form.split()[0], got, f"write {self.form}")

    def number(self, word: str) -> float:
        """Word as a number."""
        if not is_number(word) or not abs(float(word)) <= LARGEST:
            raise self.error(f"{word!r} for a number")
        return float(word)

    def count(self, word: str, most: int) -> int:
        """Word as a count of 1 to `most`."""
        if not (word.isascii() and word.isdigit() and 1 <= int(word[:9]) <= most):
            raise self.error(f"{word!r} for a count of 1 to {most}")
        return int(word[:9])

    def primitive(self, words: Sequence[str], kind: str, numbers: Sequence[float]) -> Primitive:
        """Surface with the modifier and name that the command gives."""
        return Primitive(words[0], kind, words[1], (), [float(v) for v in numbers], self.place)

    def polygon(self, words: Sequence[str], corners: np.ndarray) -> Primitive:
        """Polygon (corner, 3) with the modifier and name that the command gives."""
        return Primitive(words[0], "polygon", words[1], (), corners.ravel().tolist(), self.place)


def options(
    words: Sequence[str], leading: int, known: Mapping[str, int], usage: Usage
) -> dict[str, list[str]]:
    """Options behind the leading words, with their arguments; those of -e add up.

    Raises
    ------
    InputError
        A word is missing, or an option is not known.
    """
    if len(words) < leading:
        raise usage.error(f"{len(words)} words behind {usage.form.split()[0]}")
    given: dict[str, list[str]] = {}
    at = leading
    while at < len(words):
        option = words[at]
        if option not in known:
            raise usage.error(f"the option {option}")
        arguments = list(words[at + 1 : at + 1 + known[option]])
        if len(arguments) < known[option]:
            raise usage.error(f"{option} without its argument")
        given[option] = given.get(option, []) + arguments if option == "-e" else arguments
        at += 1 + known[option]
    return given
