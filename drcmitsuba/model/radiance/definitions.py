"""Materials and patterns by name, each with the modifiers that it had when it was defined."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from drcmitsuba.model.radiance.text import Primitive
from drcmitsuba.model.radiance.xform import STILL, Moves

SURFACES = {
    "polygon": None, "sphere": 4, "bubble": 4, "cylinder": 7, "tube": 7, "cone": 8, "cup": 8,
    "ring": 8, "source": 4, "mesh": 0, "instance": 0,
}  # fmt: skip
"""Kinds of surfaces with their number of arguments; a polygon has three for each corner."""
TEXTURES = ("texfunc", "texdata")
PATTERNS = (
    "brightfunc", "brightdata", "brighttext", "colorfunc", "colordata", "colorpict", "colortext",
    "spectrum", "specfile", "specfunc", "specdata", "specpict",
)  # fmt: skip
MIXTURES = ("mixfunc", "mixdata", "mixpict", "mixtext")
MATERIALS = (
    "plastic", "metal", "trans", "plastic2", "metal2", "trans2", "ashik2", "dielectric",
    "interface", "glass", "plasfunc", "metfunc", "transfunc", "BRTDfunc", "WGMDfunc", "plasdata",
    "metdata", "transdata", "BSDF", "aBSDF", "antimatter", "light", "illum", "glow", "spotlight",
    "mirror", "prism1", "prism2", "mist",
)  # fmt: skip
MODIFIERS = frozenset((*TEXTURES, *PATTERNS, *MIXTURES, *MATERIALS))

_NAMED = {"illum": 1, "mirror": 1, **dict.fromkeys(MIXTURES, 2)}
"""Number of leading strings that name other modifiers."""
_ORIENTED = ("BSDF", "aBSDF", "dielectric", "interface")
"""Kinds that a transform changes, as far as they are understood."""
DEEPEST = 64
"""Largest number of modifiers in a chain."""
MOST = 200_000
"""Largest number of definitions."""


@dataclass(frozen=True, eq=False)
class Definition:
    """Modifier as it was defined; later definitions of the same name leave it as it is."""

    name: str
    """Name by which surfaces call it."""
    primitive: Primitive
    """Text that defines it, of another name for an alias."""
    modifier: Definition | None
    """Modifier of this one; None for void."""
    named: tuple[Definition | None, ...]
    """Modifiers that its arguments name."""
    number: int
    """Position in the order of definitions."""
    depth: int
    """Number of modifiers in the chain from here on."""
    folders: tuple[Path, ...]
    """Folders in which the files that it names are looked for."""
    moves: Moves = field(default=STILL)
    """Move of the files that it was read from, a single one."""

    def moved(self, moves: Moves, since: int, done: Moved) -> Definition:
        """Definition as one copy's move leaves it; those numbered below `since` stay.

        `done` holds what this copy has moved.
        """
        if self.number < since:
            return self
        if id(self) not in done:
            others = [other and other.moved(moves, since, done) for other in self._others]
            if others != list(self._others) or self.primitive.kind in _ORIENTED:
                modifier, *named = others
                moved = self.moves.then(moves)
                done[id(self)] = replace(self, modifier=modifier, named=(*named,), moves=moved)
            else:
                done[id(self)] = self
        return done[id(self)]

    @property
    def _others(self) -> tuple[Definition | None, ...]:
        return self.modifier, *self.named


Moved = dict[int, Definition]
"""Definitions that a copy has moved, by the identity of the original."""


class Definitions:
    """Modifiers that have been defined so far."""

    def __init__(self) -> None:
        self.latest: dict[str, Definition] = {}
        self.order: list[str] = []

    def of(self, name: str, user: Primitive) -> Definition | None:
        """Latest definition of a name; None for void.

        Raises
        ------
        InputError
            The name is not defined before its user.
        """
        if name == "void":
            return None
        if name not in self.latest:
            got = f"its modifier {name!r} is not defined before it"
            raise user.error(got, "give the file of materials first")
        return self.latest[name]

    def state(self) -> tuple[dict[str, Definition], int]:
        """Definitions at this point, for `restore`."""
        return dict(self.latest), len(self.order)

    def restore(self, state: tuple[dict[str, Definition], int]) -> None:
        """Forget what was defined after a state; surfaces keep what they have."""
        self.latest, count = state
        del self.order[count:]

    def add(self, primitive: Primitive, folders: tuple[Path, ...]) -> None:
        """Take in a material, texture, pattern, mixture or alias.

        Raises
        ------
        InputError
            A modifier that it names is not known, the chain of modifiers is too long, or there are
            too many.
        """
        if len(self.order) == MOST:
            raise primitive.error(f"more than {MOST} modifiers", "define each only once")
        made = (
            self._alias(primitive) if primitive.kind == "alias" else self._new(primitive, folders)
        )
        if made.depth > DEEPEST:
            raise primitive.error(f"a chain of {made.depth} modifiers", f"chain at most {DEEPEST}")
        self.latest[primitive.name] = made
        self.order.append(primitive.name)

    def _new(self, primitive: Primitive, folders: tuple[Path, ...]) -> Definition:
        names = primitive.strings[: _NAMED.get(primitive.kind, 0)]
        named = tuple(self.of(name, primitive) for name in names)
        modifier = self.of(primitive.modifier, primitive)
        depth = 1 + max((other.depth for other in (modifier, *named) if other), default=0)
        number = len(self.order)
        return Definition(primitive.name, primitive, modifier, named, number, depth, folders)

    def _alias(self, primitive: Primitive) -> Definition:
        """Copy of another definition, with the alias's own modifier unless that is "inherit"."""
        original = self.of(primitive.strings[0], primitive)
        if original is None:
            raise primitive.error("an alias of void", "name a material or a pattern")
        modifier = original.modifier
        if primitive.modifier != "inherit":
            modifier = self.of(primitive.modifier, primitive)
        depth = max(original.depth, 1 + (modifier.depth if modifier else 0))
        number = len(self.order)
        return replace(original, name=primitive.name, modifier=modifier, number=number, depth=depth)

    def move(self, moves: Moves, since: int) -> None:
        """Move all that was defined since a position, as the last copy of its file leaves it."""
        done: Moved = {}
        for name in set(self.order[since:]):
            self.latest[name] = self.latest[name].moved(moves, since, done)
