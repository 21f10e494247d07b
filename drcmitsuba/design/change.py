"""The least change of a façade for a level of a standard, in numbers and words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drcmitsuba.runtime import storage
from drcmitsuba.standards import Verdict
from drcmitsuba.standards.verdict import Outcome, likelihood

if TYPE_CHECKING:
    import pandas as pd

SAME_VALUE = 5e-4
"""Difference of a parameter that counts as none, in its unit."""


@dataclass(frozen=True)
class Move:
    """Area that changes from one material to another."""

    before: str
    after: str
    area: float
    """Area [m²]."""
    heights: tuple[float, float] | None = None
    """Heights of the lowest and the highest edge of the tiles that it lies in [m]; None for panes
    of a model."""
    places: tuple[str, ...] = ()
    """Panes and walls of a model in which it lies."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        told: dict[str, Any] = {"from": self.before, "to": self.after, "m2": self.area}
        if self.heights is not None:
            told |= dict(zip(("bottom", "top"), self.heights, strict=True))
        return told | ({"in": [*self.places]} if self.places else {})

    def text(self) -> str:
        """Write the area with its materials, and where it lies."""
        words = [f"{self.area:.2f} m² of {self.before} to {self.after}"]
        if self.heights is not None:
            low, high = self.heights
            words.append(f"between {low:.2f} and {high:.2f} m")
        if self.places:
            words.append(f"in {', '.join(self.places)}")
        return " ".join(words)


@dataclass(frozen=True)
class Change:
    """Least change of a façade for a level of a standard."""

    standard: str
    level: str
    """Level that is not reached."""
    now: Verdict
    """The façade as it is, judged by the same light paths."""
    changed: Verdict
    """The façade with the least change that reaches the level; the one that comes nearest to it if
    none does."""
    drawn: Verdict | None
    """The changed façade drawn as a case, judged by the light of other paths; None where it does
    not reach the level by those of the search, or the search was stopped."""
    reaches: bool
    """Whether the changed façade reaches the level by the light paths of the search."""
    tried: int
    """Number of façades that the search judged."""
    finished: bool
    """False if Ctrl-C stopped the search."""
    area: float
    """Area that takes another material [m²]."""
    moves: tuple[Move, ...]
    """Its parts by material, the largest first."""
    facade_area: float
    """Area of the façade, or of a model's walls or panes that are searched [m²]."""
    parameters: Mapping[str, tuple[float, float]]
    """Free parameters of one value each, now and then."""
    composition: Mapping[str, list[float]]
    """Share of every tile by material."""
    asked: Mapping[str, float] = field(default_factory=dict)
    """Limits that the search asked for, where they are higher than the standard's so that the
    façade as drawn holds its own [% or h]."""
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    """Tables of the changed façade by the names of their files: new windows of a model."""
    notes: tuple[str, ...] = ()
    """Notes on the bounds of the search."""

    @property
    def probability(self) -> float | None:
        """Probability that the changed façade reaches the level."""
        return self._level(self.changed).probability

    @property
    def is_needed(self) -> bool:
        """False where the façade as it is reaches the level by this simulation."""
        return not self._level(self.now).reached

    def _level(self, judged: Verdict) -> Outcome:
        """Outcome of the level in a verdict."""
        return next(outcome for outcome in judged.levels if outcome.name == self.level)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON; areas in m², quantities in their units."""
        quantities = {
            name: {"now": self.now.quantities[name].to_dict(), "then": i.to_dict()}
            for name, i in self.changed.quantities.items()
        }
        return {
            "standard": self.standard,
            "level": self.level,
            "needed": self.is_needed,
            "reaches": self.reaches,
            "probability": self.probability,
            "changed_m2": self.area,
            "changed_percent": 100 * self.area / self.facade_area,
            "moves": [move.to_dict() for move in self.moves],
            "parameters": {k: {"now": a, "then": b} for k, (a, b) in self.parameters.items()},
            "quantities": quantities,
            "drawn": None if self.drawn is None else self._as_drawn(self.drawn),
            "asked": dict(self.asked),
            "composition": dict(self.composition),
            "tried": self.tried,
            "finished": self.finished,
        }

    def _as_drawn(self, judged: Verdict) -> dict[str, Any]:
        """Plain values of the façade as drawn, for JSON."""
        level = self._level(judged)
        quantities = {name: i.to_dict() for name, i in judged.quantities.items()}
        return {
            "reaches": level.reached,
            "probability": level.probability,
            "quantities": quantities,
        }

    def save(self, folder: Path) -> list[Path]:
        """Write the tables to a folder, each with the standard before its name; their files."""
        files = []
        for name, table in self.tables.items():
            files.append(folder / f"{self.standard}_{name}")
            storage.save_csv(table, files[-1])
        return files

    def text(self) -> list[str]:
        """Lines for people."""
        if not self.is_needed:
            return [
                f"cheapest change for {self.level}: none: the same façade reaches it in the "
                f"simulation of all façades ({self._quantities(self.now)}; "
                f"probability {likelihood(self.probability)})"
            ]
        some = "the search was stopped; " if not self.finished else ""
        if not self.reaches:
            return [
                f"cheapest change for {self.level}: none of the {self.tried} façades that were "
                f"tried within the bounds of [design] reaches it",
                f"  {some}nearest: {self._described()}: {self._quantities(self.changed)}",
                *(f"  {note}" for note in self.notes),
            ]
        return [
            f"cheapest change for {self.level}: {self._described()}",
            f"  then {self._quantities(self.changed)}; probability {likelihood(self.probability)}",
            f"  now  {self._quantities(self.now)}, from the same simulation",
            *self._drawn_lines(),
            f"  {some}the least change of {self.tried} façades that were tried{self._at_least()}",
            *(f"  duty: {duty}" for duty in self.changed.duties if duty not in self.now.duties),
        ]

    def _drawn_lines(self) -> Iterator[str]:
        """Say what the façade brings as drawn, and what to do where that is too little."""
        if self.drawn is None:
            return
        level = self._level(self.drawn)
        how = "reached" if level.reached else "not reached"
        told = f"{how}, probability {likelihood(level.probability)}"
        yield f"  drawn and simulated afresh: {self._quantities(self.drawn)}; {told}"
        if not level.reached:
            yield "  take more of this change, or let tiles be smaller (rows, segments in [design])"

    def _at_least(self) -> str:
        """Say which limits the search asked for in place of the standard's."""
        units = self.changed.units
        limits = [f"{name} of {x:.1f} {units[name]}" for name, x in self.asked.items()]
        return f" with {' and '.join(limits)}, asked for to hold as drawn" if limits else ""

    def _described(self) -> str:
        """Write the change: "0.92 m² of film to glass between 2.10 and 2.70 m (4.0 % of …)"."""
        if not self.moves:
            return "the façade as it is"
        share = 100 * self.area / self.facade_area
        moves = ", ".join(move.text() for move in self.moves)
        values = [
            f"{name} {b:.3f}" if abs(a - b) < SAME_VALUE else f"{name} {a:.3f} → {b:.3f}"
            for name, (a, b) in self.parameters.items()
        ]
        return "; ".join([f"{moves} ({share:.1f} % of the façade)", *values])

    def _quantities(self, judged: Verdict) -> str:
        values = []
        for name, i in judged.quantities.items():
            unit = judged.units[name]
            digits = 1 if unit == "%" else 0
            value, low, high = (f"{x:.{digits}f}" for x in (i.value, i.low, i.high))
            values.append(f"{name} {value} ({low} … {high}) {unit}")
        return ", ".join(values)
