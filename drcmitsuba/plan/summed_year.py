"""A plan says what is left out of a year whose E is a sum over groups of panes, where not open.

Such a year takes more states of the façade than are simulated one by one, see
`transport.elements`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from drcmitsuba.model.materials import BsdfMaterial
from drcmitsuba.plan import panes
from drcmitsuba.plan.effect import Effect
from drcmitsuba.plan.facts import Facts
from drcmitsuba.plan.mirrors import mirrors
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.panes_behind import mirroring_before
from drcmitsuba.scene.panes_in_state import grouped_panes
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.transport.elements.mirrored_pairs import MirroredPairs

WHEN = (
    "left out of all hours in which a group is not in its first state, since their E is a sum over "
    "groups of panes"
)
ALWAYS = "left out, since E is a sum over openings and their fills"
SIZE = (
    "−1.1 % of the light of sky and suns, up to 3.5 % at a sensor, in a room with glass, a film "
    "and a fabric in three façades"
)
"""Measured in `docs/howto/groups.md`."""


def summed(
    effects: Mapping[str, Effect], facts: Facts, scope: EnabledEffects, *, always: bool
) -> dict[str, Effect]:
    """Decisions on a summed year, from those on its open façade.

    The open façade is simulated as a whole, unless it is a sum, too: `always`.
    """
    between, when, beside = effects["pane_to_pane"], WHEN, "; in other hours: "
    if always:
        when, beside = ALWAYS, "; a simulation has: "
    if between.on and (panes.of(facts.case, BsdfMaterial) or mirroring_before(facts.case)):
        reason = (
            f"light that films send from pane to pane, or throw back by their lobes, is {when} "
        )
        reason += f"({SIZE}){beside}{between.reason}"
        between = replace(between, on=False, reason=reason, missing=True)
    elif between.on and not always:  # light by element tells its own
        between = _between_pairs(between, facts, when)
    images, colour = _images(effects["mirrors"], facts, scope, when, beside), effects["colour"]
    if facts.case.colour.wavelengths:
        # Who has nothing but sums says so by `spectral_year.left_out`.
        reason = "bands of colour are left out, since E of some hours is a sum over groups of panes"
        colour = replace(colour, on=False, reason=reason, missing=not always)
    return {**effects, "pane_to_pane": between, "mirrors": images, "colour": colour}


def _between_pairs(between: Effect, facts: Facts, when: str) -> Effect:
    """Light from pane to pane, of which pairs of small panes may be missing."""
    groups = prepared(facts.case).groups
    pairs = MirroredPairs.of(grouped_panes(facts.case, groups=groups), groups.states.starts)
    if not pairs.left_out:
        return between
    reason = f"{between.reason}; {pairs.left_out} of {pairs.left_out + len(pairs)} pairs of "
    reason += f"openings, those of the smaller panes, are {when}"
    return replace(between, reason=reason, missing=True)


def _images(every: Effect, facts: Facts, scope: EnabledEffects, when: str, beside: str) -> Effect:
    """Decide on images of suns, of which those in polished surfaces may be missing."""
    polished = facts.case.building.polished
    if not every.on or not polished:
        return every
    kept = mirrors(replace(facts, case=facts.case.without_polish()), scope)
    lost = f"in polished surfaces ({', '.join(polished)}; diffuse there, E up to 1 % lower)"
    reason = f"images {lost} are {when}{beside}{every.reason}"
    return Effect(kept.on, reason, every.quantities, missing=True)
