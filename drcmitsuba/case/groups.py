"""The table `[groups]` of a case: panes that change their state together, and their states.

A *state of the façade* is written with the state of every group, in the order of the groups:
"open/blind". "open" alone stands for every group open, "shaded" for every group in its last state.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import accumulate
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Name, Table, choose, shortened

Direction = Literal[
    "north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west",
    "above", "below",
]  # fmt: skip
State = str
"""State of the façade."""
OPEN: State = "open"
SHADED: State = "shaded"
VARYING: State = "varying"
"""In place of the states of a year that takes more of them than are simulated one by one."""
APPLIED: State = "applied"
"""In place of a state: the state that the shade takes at each time stamp."""
BLOCKED, HIDDEN = -1, -2
"""Indices of states that every group has beside its own: black sheets, or holes, for panes."""
_SPECIAL = {BLOCKED: "(blocked)", HIDDEN: "(hidden)"}
RESERVED = {OPEN, SHADED, VARYING, APPLIED, *_SPECIAL.values()}
"""Names that no state of a group has but by this module."""
OTHERS = "(others)"
"""Group of the panes that belong to no group, which has one state only."""


class Group(Table):
    """Panes that change their state together: one blind, or one switchable glazing."""

    panes: Annotated[tuple[Name, ...], Field(max_length=1000)] = ()
    """Names of the panes' materials; `*` stands for any text. By default the panes of the model's
    own group of this name, with the states that the model gives them."""
    facing: Direction | None = None
    """Direction that the outer sides of the panes face, before a [room] is turned by `rotation`; by
    default any."""
    spaces: Annotated[tuple[Name, ...], Field(max_length=10_000)] = ()
    """Names of a model's spaces in which the panes stand; `*` stands for any text. By default in
    any. The rule of [shading] closes such a group by the sun on sensors of these spaces alone."""
    states: Annotated[tuple[Name, ...], Field(max_length=100)] = ()
    """Materials that the panes take, one for each further state; in the first state, `open`, they
    have their own. By default the material of [shading]."""
    schedule: Path | None = None
    """CSV with a name of a state for every hour of the year, in the column of the group's name; by
    default the panes take their last state by the rule of [shading]."""


@dataclass(frozen=True)
class GroupStates:
    """Names of the groups of a façade, and of the states that each may take."""

    names: tuple[str, ...]
    states: tuple[tuple[str, ...], ...]
    """States of every group, "open" first."""
    bare: tuple[tuple[str, str], ...] = ()
    """Groups and further states of theirs in which no shade stands, as a choice by the hour has."""

    @classmethod
    def of_shade(cls) -> GroupStates:
        """One group, the panes that the shade covers."""
        return cls(("shade",), ((OPEN, SHADED),))

    @classmethod
    def of_attributes(cls, attributes: Mapping[str, Any]) -> GroupStates:
        """Read the groups from the attribute `groups` of C or E; one shade without it."""
        if "groups" not in attributes:
            return cls.of_shade()
        try:
            table = json.loads(attributes["groups"])
            names, states = tuple(table["names"]), tuple(map(tuple, table["states"]))
            bare = tuple((str(name), str(state)) for name, state in table.get("bare", ()))
            groups = cls(names, states, bare)
            fits = 0 < len(groups.names) == len(groups.states) and all(
                states[:1] == (OPEN,) and all(isinstance(name, str) for name in states)
                for states in groups.states
            )
        except (ValueError, TypeError, KeyError):
            fits = False
        if not fits:
            got = shortened(str(attributes["groups"]))
            raise InputError("coefficients", "groups", got, "compute them anew")
        return groups

    def attributes(self) -> dict[str, str]:
        """Attribute `groups`; none for one shade."""
        return {} if self == self.of_shade() else {"groups": json.dumps(asdict(self))}

    def __len__(self) -> int:
        """Count the groups."""
        return len(self.names)

    @property
    def closable(self) -> tuple[bool, ...]:
        """Whether each group has more than one state."""
        return tuple(len(states) > 1 for states in self.states)

    def share_closed(self, indices: np.ndarray) -> np.ndarray:
        """Share of the groups with a shade that have closed it, by `indices` (…, group).

        A shade is any state but the first one and the `bare` ones. It is 0 where there is none.
        """
        named = zip(self.names, self.states, strict=True)
        shut = [[k > 0 and (g, s) not in self.bare for k, s in enumerate(of)] for g, of in named]
        shaded = [np.array(of)[indices[..., g]] for g, of in enumerate(shut) if any(of)]
        closed: np.ndarray = sum(shaded, np.zeros(indices.shape[:-1]))
        return closed / max(len(shaded), 1)

    @property
    def last(self) -> tuple[int, ...]:
        """Index of the last state of every group."""
        return tuple(len(states) - 1 for states in self.states)

    @property
    def starts(self) -> tuple[int, ...]:
        """Number of every group's first state among the states of all; the number of all last."""
        return (0, *accumulate(map(len, self.states)))

    @property
    def in_step(self) -> tuple[tuple[int, ...], ...]:
        """States of the groups with all of them in their first one, all in their next, and so on.

        A group that has no more stays in its last one.
        """
        count = max(self.last, default=0) + 1
        return tuple(tuple(min(k, last) for last in self.last) for k in range(count))

    def label(self, indices: Sequence[int]) -> State:
        """State of the façade with these states of its groups."""
        if not any(indices):
            return OPEN
        chosen = zip(self.states, indices, strict=True)
        return "/".join(_SPECIAL[i] if i < 0 else states[i] for states, i in chosen)

    def indices(self, state: State) -> tuple[int, ...]:
        """Index of the state of every group in a state of the façade.

        Raises
        ------
        InputError
            A group has no such state.
        """
        if state == OPEN:
            return (0,) * len(self)
        if state == SHADED:
            return self.last
        parts = state.split("/")
        if len(parts) != len(self):
            got = f"{shortened(state)} for {len(self)} groups ({', '.join(self.names)})"
            raise InputError("groups", "state", got, 'name the state of each: "open/closed"')
        special, indices = {name: i for i, name in _SPECIAL.items()}, []
        for name, part, known in zip(self.names, parts, self.states, strict=True):
            if part not in (*known, *special):
                got = f"no state {shortened(part)}"
                raise InputError("groups", name, got, choose(part, known))
            indices.append(special[part] if part in special else known.index(part))
        return tuple(indices)


def told_apart(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of states without slashes, each once."""
    clean = [name.replace("/", "-") for name in names]
    return tuple(
        name if clean.count(name) == 1 and name not in RESERVED else f"{name} {i}"
        for i, name in enumerate(clean, 1)
    )
