"""Which effects a case calls for, and why: decided before anything is loaded or traced."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.plan import decide, reflected
from drcmitsuba.plan.effect import Effect
from drcmitsuba.plan.facts import Facts
from drcmitsuba.plan.mirrors import mirrors
from drcmitsuba.plan.summed_year import summed
from drcmitsuba.scene.components import place
from drcmitsuba.scene.daylit import refuse_darkness
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS, EnabledEffects
from drcmitsuba.scene.leaks import refuse_leaks
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.sensors import any_outside
from drcmitsuba.scene.sun_visibility import SunVisibility, VisibleSuns
from drcmitsuba.sky.daylight import Daylight


@dataclass(frozen=True)
class Plan:
    """Decisions on all effects of a case.

    Parameters
    ----------
    facts : Facts
    effects : dict of str to Effect
        Decision on each effect, by name.
    scope : EnabledEffects
        The same decisions, as transport reads them; of a summed year, those on its open façade.
    is_sum : bool
        Whether the decisions are those on a summed year.
    """

    facts: Facts
    effects: dict[str, Effect]
    scope: EnabledEffects
    is_sum: bool = False

    @cached_property
    def simulated(self) -> Case:
        """The case as it is simulated: without a shade that never closes."""
        case = self.facts.case
        return case if self.scope.shade else case.with_tables(shading=None, groups={})

    @property
    def of_any_facade(self) -> EnabledEffects:
        """Effects of a search, which simulates whatever its façades may call for."""
        planned = self.scope
        return replace(
            ALL_EFFECTS, solved_cells=planned.solved_cells, pane_to_pane=planned.pane_to_pane
        )

    def summed(self, *, always: bool = False) -> Plan:
        """Say what is left out of a year whose E is a sum over groups of panes.

        The open façade is simulated as a whole, unless it is a sum, too: `always`.
        """
        if self.is_sum:
            return self
        effects = summed(self.effects, self.facts, self.scope, always=always)
        return replace(self, effects=effects, is_sum=True)

    def notes(self) -> list[str]:
        """Reasons of the effects that are left out though the scene calls for them."""
        left_out = (e for e in self.effects.values() if e.missing or (e.overruled and not e.on))
        return [effect.reason for effect in left_out]

    def to_dict(self, coefficients: Mapping[str, Any] = MappingProxyType({})) -> dict[str, Any]:
        """Plain values for plan.json: {effect: {"on": bool, "reason": str, …}}.

        The attributes of C, where it is known, add size and error of a mesh of suns, and pairs of
        openings that are left out.
        """
        entries = {name: effect.to_dict() for name, effect in self.effects.items()}
        if "mesh_miss" in coefficients:
            suns, miss = coefficients["mesh_suns"], 100 * coefficients["mesh_miss"]
            entries["suns"]["reason"] += (
                f"; the mesh has {suns:g} suns and misses suns in between by {miss:.1f} % (RMS)"
            )
            entries["suns"] |= {"mesh_suns": suns, "mesh_miss": coefficients["mesh_miss"]}
        if pairs := coefficients.get("pairs_left_out"):
            entries["pane_to_pane"]["reason"] += f"; {pairs} pairs of openings are left out"
            entries["pane_to_pane"] |= {"pairs_left_out": pairs}
        return entries


def plan(case: Case, light: Daylight, eyes: np.ndarray | None = None) -> Plan:
    """Decide which effects of a case are simulated in the daylight of its time stamps.

    Parameters
    ----------
    case : Case
    light : Daylight
    eyes : np.ndarray, shape (eye, 3), optional
        Positions [m], in the frame of the case's file, of eyes that are lit beside the sensors.

    Raises
    ------
    InputError
        A component or a BSDF file is unfit, or a model leaks.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.plan import plan
    >>> from drcmitsuba.sky.daylight import daylight
    >>> case = drcmitsuba.load_case("office.toml")
    >>> decided = plan(case, daylight(case))
    """
    refuse_leaks(case)
    refuse_darkness(case)
    components = place(case)
    # Sensors and eyes before a façade get light of suns that reach no opening.
    outside = prepared(case).sensors.outside or (eyes is not None and any_outside(case, eyes))
    reach = None if outside else SunVisibility.of(case, components)
    everything = VisibleSuns(np.ones(len(light.suns.labels), bool), 0, 0, 1.0)
    suns = light.suns
    reached = everything if reach is None else reach.visible(suns.directions, suns.diameter)
    facts = Facts(case, light, components, reach, reached)
    interreflection, depth = reflected.interreflection(facts)
    decisions = {
        "sky": decide.sky(facts),
        "ground": decide.ground(facts),
        "suns": decide.suns(facts),
        "dark_hours": decide.dark_hours(facts),
        "clear_panes": decide.clear_panes(facts),
        "scattering_panes": decide.scattering_panes(facts),
        "films": decide.films(facts),
        "straight_through": decide.straight_through(facts),
        "pane_to_pane": decide.pane_to_pane(facts),
        "components": decide.components(facts),
        "obstructions": decide.obstructions(facts),
        "shaded_state": decide.shaded_state(facts),
        "interreflection": interreflection,
        "solved_cells": reflected.solved_cells(facts, depth),
        "colour": decide.colour(facts),
        "pictures": decide.pictures(facts),
        "gradients": decide.gradients(facts),
    }
    chosen = case.effects.model_dump()
    effects = {
        name: effect.decided(name, chosen.get(name, "auto")) for name, effect in decisions.items()
    }
    scope = _scope(facts, effects, chosen, depth)
    return Plan(facts, {**effects, "mirrors": mirrors(facts, scope)}, scope)


def _scope(
    facts: Facts, effects: dict[str, Effect], chosen: dict[str, str], depth: int | None
) -> EnabledEffects:
    """Translate the decisions for transport."""

    def on(name: str) -> bool:
        return effects[name].on

    def forced(name: str) -> bool:
        return chosen[name] == "all"

    most = {"auto": depth, "all": None, "off": 0}[chosen["interreflection"]]
    overruled_view = effects["straight_through"].overruled
    return EnabledEffects(
        sky=on("sky"),
        ground=on("ground"),
        suns=on("suns"),
        sun_visibility=None if forced("suns") else facts.reach,
        clear_panes=on("clear_panes"),
        scattering_panes=on("scattering_panes"),
        films=on("films"),
        enclosed=not (forced("clear_panes") or forced("suns")),
        straight_through=on("straight_through") if overruled_view else None,
        components=on("components"),
        obstructions=on("obstructions"),
        pane_to_pane=on("pane_to_pane"),
        beyond=on("obstructions") or bool(facts.case.standing or facts.case.building.layers),
        shade=on("shaded_state"),
        every_shade=forced("shaded_state"),
        depth=most,
        solved_cells=on("solved_cells") and most != 0,
        channels=on("colour") and not facts.case.colour.wavelengths,
        pictures=on("pictures"),
    )
