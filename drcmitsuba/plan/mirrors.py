"""Planar mirrors of a case: where suns have images, and through which openings they are seen."""

from __future__ import annotations

import numpy as np

from drcmitsuba.case.groups import OPEN
from drcmitsuba.plan.effect import Effect
from drcmitsuba.plan.facts import Facts
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.geometry import Surface, normals
from drcmitsuba.scene.panes_of_model import side_name
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.transport.planar_mirrors import (
    MOST_IN_TURN,
    has_images,
    is_planar_mirror,
    planes_followed,
)

MOST_NAMES = 6
"""Largest number of mirrors that are named."""


def mirrors(facts: Facts, scope: EnabledEffects) -> Effect:
    """Decide on images of suns in panes and smooth mirrors, in the scope of the other effects."""
    surfaces = [s for s in surfaces_of(facts.case, OPEN, scope) if is_planar_mirror(s)]
    surfaces = [s for s in surfaces if has_images(s, scope)]
    if not surfaces:
        return Effect(False, "no panes or smooth mirrors in few planes that mirror suns to a side")
    panes = sum(len(s.quads) for s in surfaces)
    followed, left_out = planes_followed(np.concatenate([s.quads for s in surfaces]))
    told = [f"{s.name} ({_seen_from(s, facts)})" for s in surfaces[:MOST_NAMES]]
    more = len(surfaces) - len(told)
    reason = f"suns have images in {followed} planes of {panes} faces: {', '.join(told)}"
    reason += f" and {more} more" if more else ""
    reason += f"; up to {MOST_IN_TURN} mirrors in turn"
    quantities = {"planes": followed, "faces": panes}
    if left_out:
        reason += f"; {left_out} planes more, the smallest ones, mirror no sun"
        quantities["left_out"] = left_out
    return Effect(True, reason, quantities)


def _seen_from(surface: Surface, facts: Facts) -> str:
    """Sides of the openings that have a mirror before them."""
    if facts.reach is None:
        return "seen from the open"
    corners, sides = surface.quads.reshape(-1, 3), list[str]()
    openings = facts.reach.openings
    for quad, n in zip(openings, normals(openings), strict=True):
        if ((corners - quad[0]) @ n > 1e-3).any():
            sides.append(side_name(-n, True))
    named = ", ".join(dict.fromkeys(sides))
    return f"seen through openings to the {named}" if named else "seen beside the openings"
