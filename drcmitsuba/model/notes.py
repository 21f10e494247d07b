"""Sentences about what was simplified, each with the names that it is about."""

from __future__ import annotations

from dataclasses import dataclass, field

MOST_NAMES = 8
"""Largest number of names in a sentence."""


@dataclass
class Notes:
    """Notes of a reading, in the order in which they came up."""

    names: dict[str, dict[str, None]] = field(default_factory=dict)
    """Names by the sentence, without its stop, that is about them."""

    def add(self, sentence: str, name: str = "") -> None:
        """Add a name to a sentence."""
        self.names.setdefault(sentence, {})[name] = None

    def sentences(self) -> tuple[str, ...]:
        """One sentence for each note."""
        out = []
        for sentence, names in self.names.items():
            listed = [name for name in names if name]
            more = len(listed) - MOST_NAMES
            text = ", ".join(listed[:MOST_NAMES]) + (f" and {more} more" if more > 0 else "")
            out.append(f"{sentence}: {text}." if text else f"{sentence}.")
        return tuple(out)
