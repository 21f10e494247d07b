"""Sentences about what was simplified, each with the names that it is about."""

from __future__ import annotations

MOST_NAMES = 8
"""Largest number of names in a sentence."""


class Notes:
    """Notes of a reading, in the order in which they came up."""

    def __init__(self) -> None:
        self._names: dict[str, dict[str, None]] = {}

    def add(self, sentence: str, name: str = "") -> None:
        """Add a name to a sentence, which ends without a stop."""
        names = self._names.setdefault(sentence, {})
        if name:
            names[name] = None

    def sentences(self) -> tuple[str, ...]:
        """One sentence for each note."""
        return tuple(self._sentence(text, list(names)) for text, names in self._names.items())

    @staticmethod
    def _sentence(text: str, names: list[str]) -> str:
        if not names:
            return f"{text}."
        more = len(names) - MOST_NAMES
        listed = ", ".join(names[:MOST_NAMES]) + (f" and {more} more" if more > 0 else "")
        return f"{text}: {listed}."
