"""A plan says what is left out of a year whose E is a sum over groups of panes, where not open.

Such a year takes more states of the façade than are simulated one by one, see
`transport.elements`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from drcmitsuba.plan.effect import Effect
from drcmitsuba.plan.facts import Facts
from drcmitsuba.plan.mirrors import mirrors
from drcmitsuba.scene.enabled_effects import EnabledEffects

WHEN = (
    "left out of all hours in which a group is not in its first state, since their E is a sum over "
    "groups of panes"
)
ALWAYS = "left out, since E is a sum over openings and their fills"
SIZE = (
    "−0.6 % of the sky's light, −1.8 % of the ground's and up to 10 % of a patch's in a room with "
    "windows in three façades"
)
"""Measured in `docs/howto/groups.md`."""


def summed(
    effects: Mapping[str, Effect], facts: Facts, scope: EnabledEffects, *, always: bool
) -> dict[str, Effect]:
    """Decisions on a summed year, from those on its open façade.

    The open façade is simulated as a whole, unless it is a sum, too: `always`.
    """
    panes, when, beside = effects["pane_to_pane"], WHEN, "; in other hours: "
    if always:
        when, beside = ALWAYS, "; a simulation has: "
    if panes.on:
        reason = f"light from pane to pane is {when} ({SIZE}){beside}{panes.reason}"
        panes = replace(panes, on=False, reason=reason, missing=True)
    images, colour = _images(effects["mirrors"], facts, scope, when, beside), effects["colour"]
    if facts.case.colour.wavelengths:
        # Who has nothing but sums says so by `spectral_year.left_out`.
        reason = "bands of colour are left out, since E of some hours is a sum over groups of panes"
        colour = replace(colour, on=False, reason=reason, missing=not always)
    return {**effects, "pane_to_pane": panes, "mirrors": images, "colour": colour}


def _images(every: Effect, facts: Facts, scope: EnabledEffects, when: str, beside: str) -> Effect:
    """Decide on images of suns, of which those in polished surfaces and in panes may be missing."""
    dull = replace(facts, case=facts.case.without_polish())
    kept = mirrors(dull, replace(scope, pane_to_pane=False))
    if not every.on or kept == every:
        return every
    lost = ["in panes"] if scope.pane_to_pane else []
    if polished := facts.case.building.polished:
        names = ", ".join(polished)
        lost.append(f"in polished surfaces ({names}; diffuse there, E up to 1 % lower)")
    reason = f"images {' and '.join(lost)} are {when}{beside}{every.reason}"
    return Effect(kept.on, reason, every.quantities, missing=bool(polished))
