"""Scenes in which the light paths of a view are traced, whatever fills its openings have.

case, openings ─ grouped_panes ─► panes of the openings that have several fills
     ─ SeenOpenings ────────────► opening that a ray of the eye, or one to the sky, meets
     ─ OpeningMarks ────────────► `inner`: paths between surfaces draw a fill at each opening
     ─ scene.load ──────────────► `fills`: the façade with the first fill everywhere, the next one …
                                  `load`: the façade in a state, under the sun of an hour
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import HIDDEN
from drcmitsuba.eye.openings import SeenOpenings
from drcmitsuba.runtime.ray_counter import RayCounter
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.geometry import Surface
from drcmitsuba.scene.materials import lets_through
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_in_state import GroupedPanes, grouped_panes
from drcmitsuba.scene.scene import Scene, Tint, untinted
from drcmitsuba.transport.elements.marks import OpeningMarks

Indices = tuple[int, ...]
"""Fill of every opening, an index."""


@dataclass(frozen=True, eq=False)
class FacadeScenes:
    """Scenes of a case in a colour channel or a band, with any fills of its openings."""

    fills: tuple[Scene, ...]
    """Scene with the first fill in every opening, with the second one, and so on; an opening that
    has no more keeps its last one."""
    inner: Scene
    """Scene of paths between surfaces, in which `marks` draw the fill of each opening."""
    load: Callable[[Indices], Scene]
    """Gives the scene with a fill in each opening."""
    openings: SeenOpenings | None = None
    """Openings of several fills; None without any."""
    marks: OpeningMarks | None = None
    letting_through: tuple[int, ...] = (0,)
    """First fill, which stands for what passes no opening as well, and the others that let straight
    light through some opening."""

    @classmethod
    def alone(cls, world: Scene) -> FacadeScenes:
        """Take the one scene of a façade that does not change."""
        return cls((world,), world, lambda indices: world)

    @classmethod
    def of(
        cls, case: Case, panes: PaneGroups, channel: int, effects: EnabledEffects,
        tint: Tint = untinted,
    ) -> FacadeScenes:  # fmt: skip
        """Load the scenes of a case.

        Parameters
        ----------
        case : Case
        panes : PaneGroups
            Openings and their fills, of which some opening has several.
        channel, effects, tint
            As for `scene.load`.
        """
        states = panes.states

        counter = RayCounter()

        def load(indices: Indices) -> Scene:
            made = scene.load(case, states.label(indices), channel, effects, panes, tint)
            return replace(made, ray_counter=counter)

        several = [len(fills) > 1 for fills in states.states]
        every = grouped_panes(case, effects, panes)
        mine = [_tinted(each, tint) for each in every if several[each.group]]
        marks = OpeningMarks(mine, np.array(states.starts), channel, deposits=False)
        empty = load(tuple(HIDDEN if many else 0 for many in several))
        return cls(
            tuple(map(load, states.in_step)), marks.placed_in(empty), load,
            SeenOpenings.of(mine, states.starts), marks, _letting_through(mine),
        )  # fmt: skip

    @property
    def looks(self) -> int:
        """Number of looks at panes of a ray from a surface, in all fills."""
        return sum(map(looks_of, self.fills))


def looks_of(world: Scene) -> int:
    """Number of looks at the panes of a scene: two at films, and two at diffusing panes."""
    return 2 * (bool(world.films) + bool(world.scattering))


def _tinted(panes: GroupedPanes, tint: Tint) -> GroupedPanes:
    """Panes with the materials that they take."""
    materials = (m and tint(Surface(panes.name, m, panes.quads)) for m in panes.materials)
    return replace(panes, materials=tuple(materials))


def _letting_through(panes: Sequence[GroupedPanes]) -> tuple[int, ...]:
    """Fills that let straight light through the panes of some opening, and the first one."""
    fills = {0}
    for each in panes:
        fills |= {k for k, m in enumerate(each.materials) if m is None or lets_through(m)}
    return tuple(sorted(fills))
