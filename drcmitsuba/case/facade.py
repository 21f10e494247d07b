"""The tables `[facade.SIDE]` of a case: sides of the room, cut into strips."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated

from pydantic import Field, model_validator

from drcmitsuba.model.materials import Material, Reflectance
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Length, Side, Table, choose, shortened

THINNEST = 1e-3
"""Smallest width and height of a pane [m]; smaller values are taken for mistakes."""


class Strip(Table):
    """Horizontal strip of a façade between two heights; the area without strips is wall."""

    bottom: Annotated[float, Field(ge=0)]
    """Height of the lower edge above the floor [m]."""
    top: Length
    """Height of the upper edge above the floor [m]."""
    material: str
    """Name of a pane's material or of a structure in [components], "open" (a hole) or "wall"."""
    segments: (
        Annotated[tuple[Annotated[int, Field(ge=0, lt=200)], ...], Field(min_length=1)] | None
    ) = None
    """Segments with this strip, counted from 0 at the left, seen from outside; default: all."""

    @model_validator(mode="after")
    def _order(self) -> Strip:
        if self.top <= self.bottom:
            got = f"{self.top:g} m is not above the bottom, {self.bottom:g} m"
            raise InputError("strip", "top", got, "give the higher edge as top")
        if self.segments is not None and len(set(self.segments)) < len(self.segments):
            got = f"{shortened(self.segments)} names one twice"
            raise InputError("strip", "segments", got, "name each segment once")
        return self

    def covers(self, segment: int) -> bool:
        """Whether the strip lies in a segment of the façade."""
        return self.segments is None or segment in self.segments


class Facade(Table):
    """One side of the room, cut into equal segments and strips."""

    segments: Annotated[int, Field(ge=1, le=200)] = 1
    """Number of equal segments side by side, each with panes of its own."""
    frame: Annotated[float, Field(ge=0)] = 0.0
    """Width of the opaque frame between neighbouring panes [m]; each edge of a pane loses half."""
    frame_reflectance: Reflectance = 0.5
    """Reflectance of the frame [–]: one number, or [red, green, blue]."""
    strips: Annotated[tuple[Strip, ...], Field(max_length=2000)] = ()
    """Strips of panes; the rest of the side is wall."""

    def columns(self) -> list[tuple[range, tuple[Strip, ...]]]:
        """Groups of neighbouring segments with the same strips, and these from the bottom up."""
        groups: list[tuple[range, tuple[Strip, ...]]] = []
        for i in range(self.segments):
            stack = sorted((s for s in self.strips if s.covers(i)), key=lambda s: s.bottom)
            if groups and groups[-1][1] == tuple(stack):
                groups[-1] = range(groups[-1][0].start, i + 1), groups[-1][1]
            else:
                groups.append((range(i, i + 1), tuple(stack)))
        return groups

    def check(
        self, side: Side, wall: tuple[float, float], known: Sequence[str], named: Sequence[str]
    ) -> None:
        """Raise InputError for strips that do not fit into their wall (width, height [m]).

        A strip may not be higher than the wall, overlap another one, lie in no segment, be all
        frame, or be of a material that is not among the `known` names. `named` are the names of
        all materials and components of the case.
        """
        width, height = wall

        def refuse(strip: Strip, got: str, remedy: str) -> None:
            where = f"facade.{side}.strips, {strip.bottom:g} to {strip.top:g} m"
            raise InputError("case", where, got, remedy)

        for strip in sorted(self.strips, key=lambda s: s.bottom):
            if strip.material not in known:
                what = "no pane is made of" if strip.material in named else "unknown material"
                got = f"{what} {shortened(strip.material)}"
                refuse(strip, got, choose(strip.material, known))
            if strip.top > height:
                refuse(strip, f"the room is {height:g} m high", "lower the top")
            beyond = max(strip.segments or (0,))
            if beyond >= self.segments:
                got = f"there is no segment {beyond} of {self.segments}"
                refuse(strip, got, f"count from 0 to {self.segments - 1}")
            pane = min(width / self.segments, strip.top - strip.bottom) - self.frame
            if pane < THINNEST - 1e-9 and strip.material != "wall":
                if not self.frame:
                    refuse(strip, f"panes of {pane:.2g} m", f"give {THINNEST:g} m or more")
                got = f"a frame of {self.frame:g} m leaves no pane"
                refuse(strip, got, "give a narrower frame, fewer segments or a higher strip")
        for _, strips in self.columns():
            top = 0.0
            for strip in strips:
                if strip.bottom < top:
                    refuse(strip, "overlaps the strip below it", f"start at {top:g} m or above")
                top = strip.top


def check_names(materials: Mapping[str, Material]) -> None:
    """Raise InputError for materials with the names that strips use for wall and holes."""
    for name in ("wall", "open"):
        if name in materials:
            got = "strips use this name for no material"
            raise InputError("case", f"materials.{name}", got, "choose another name")
