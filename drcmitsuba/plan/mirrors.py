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
from drcmitsuba.transport.mirrors.mirror_planes import (
    MOST_IN_TURN,
    chains_left_out,
    planes_followed,
)
from drcmitsuba.transport.mirrors.planar_mirrors import (
    FAINT_TURN,
    albedo,
    has_images,
    is_planar_mirror,
    is_rough_mirror,
)

MOST_NAMES = 6
"""Largest number of mirrors that are named."""


def mirrors(facts: Facts, scope: EnabledEffects) -> Effect:
    """Decide on images of suns in panes and smooth mirrors, in the scope of the other effects."""
    every = [s for s in surfaces_of(facts.case, OPEN, scope)
             if (is_planar_mirror(s) or is_rough_mirror(s)) and has_images(s, scope)]  # fmt: skip
    surfaces = [s for s in every if is_planar_mirror(s)]
    rough = [s for s in every if is_rough_mirror(s)]
    if not every:
        return Effect(False, "no panes or mirrors in few planes that mirror suns to a side")
    images, quantities = _images(surfaces, facts) if surfaces else ("", {})
    if rough:
        quantities["rough"] = sum(len(s.quads) for s in rough)
    parts = [images, _lobes(rough, facts) if rough else ""]
    return Effect(True, "; ".join(filter(None, parts)), quantities)


def _images(surfaces: list[Surface], facts: Facts) -> tuple[str, dict[str, int]]:
    """Words for panes and smooth mirrors, and their numbers."""
    panes = sum(len(s.quads) for s in surfaces)
    followed, left_out = planes_followed(np.concatenate([s.quads for s in surfaces]))
    quads: dict[str, list[np.ndarray]] = {}
    for surface in surfaces:
        quads.setdefault(surface.name, []).append(surface.quads)
    few = [*quads.items()][:MOST_NAMES]
    told = [f"{name} ({_seen_from(np.concatenate(some), facts)})" for name, some in few]
    more = len(quads) - len(few)
    reason = f"suns have images in {followed} planes of {panes} faces: {', '.join(told)}"
    reason += f" and {more} more" if more else ""
    reason += f"; up to {MOST_IN_TURN} mirrors in turn"
    quantities = {"planes": followed, "faces": panes}
    if left_out:
        reason += f"; {left_out} planes more, the smallest ones, mirror no sun"
        quantities["left_out"] = left_out
    rho = [albedo(s.material) for s in surfaces]
    chains, strongest = chains_left_out([s.quads for s in surfaces], rho)
    if chains:
        reason += f"; {chains} pairs of mirrors more send on no sun in turn, "
        reason += f"the strongest of them {100 * strongest:.2g} % of it"
        quantities["chains_left_out"] = chains
    return reason, quantities


def _lobes(rough: list[Surface], facts: Facts) -> str:
    """Words for rough mirrors."""
    named = ", ".join(f"{s.name} ({_seen_from(s.quads, facts)})" for s in rough[:MOST_NAMES])
    named += f" and {len(rough) - MOST_NAMES} more" if len(rough) > MOST_NAMES else ""
    return (
        f"suns and sky have lobes in rough mirrors: {named}; what one of them and another mirror "
        f"send on in turn is left out up to a product of {FAINT_TURN:g}, and by photons above"
    )


def _seen_from(quads: np.ndarray, facts: Facts) -> str:
    """Sides of the openings that have mirrors (quad, 4, 3) before them."""
    if facts.reach is None:
        return "seen from the open"
    corners, sides = quads.reshape(-1, 3), list[str]()
    openings = facts.reach.openings
    for quad, n in zip(openings, normals(openings), strict=True):
        if ((corners - quad[0]) @ n > 1e-3).any():
            sides.append(side_name(-n, True))
    named = ", ".join(dict.fromkeys(sides))
    return f"seen through openings to the {named}" if named else "seen beside the openings"
