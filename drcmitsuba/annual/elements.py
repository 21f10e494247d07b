"""Light of a case by opening and fill, from which any façade is evaluated without its own rays.

case, fills ─ openings_of ─► openings with their fills
     ─ elements.compute ───► light by element, channel by channel
choice ─ ChosenFills ──────► shares that stay, groups that move
     ─ recombined ─────────► E of the states that the groups take, Result
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.annual.attributes import attributes
from drcmitsuba.annual.choice import Choice, ChosenFills
from drcmitsuba.annual.chosen_facade import ChosenFacade, KnownLight
from drcmitsuba.annual.light_with_surfaces import (
    light_with_surfaces,
    simulate_scheduled,
    simulate_sets,
)
from drcmitsuba.annual.recombined_year import recombined
from drcmitsuba.annual.result import Result
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.summed_year import Opened
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.case.reading import load_case
from drcmitsuba.plan import Plan, notes, without_rounds
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.labelled import in_order
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.runtime.threads import one_blas_thread
from drcmitsuba.scene.fills import Fills, names_of
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_in_state import groups_with_surfaces
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.schema import describe, mean_and_error
from drcmitsuba.sky.daylight import Daylight, daylight_and_year
from drcmitsuba.transport.elements import LightByElement
from drcmitsuba.transport.elements.light_of_surfaces import AnyLight


@dataclass(frozen=True, repr=False)
class Elements:
    """Light of a case by element, an opening with one fill; shows itself in Jupyter."""

    case: Case
    daylight: Daylight
    planned: Plan
    run: Run
    panes: PaneGroups
    """Openings of the case with all of their fills."""
    channels: tuple[AnyLight, ...]
    """Light of every colour channel; one of a grey case."""

    @property
    def groups(self) -> GroupStates:
        """Openings and their fills as groups of panes and states, as controls know them."""
        return self.panes.states

    @property
    def openings(self) -> tuple[str, ...]:
        """Names of the openings."""
        return self.groups.names

    @property
    def fills(self) -> dict[str, tuple[str, ...]]:
        """Names of the fills by opening; the first one is what the case draws there."""
        return names_of(self.case, self.panes)

    def evaluate(self, choice: Choice | None = None, drawn: Choice | None = None) -> Result:
        """Evaluate a façade: E, metrics and their intervals, without tracing it.

        Parameters
        ----------
        choice : mapping, optional
            Fill by opening: the name of a fill, shares of fills by name that add up to 1, or
            either by the hour, a DataArray over `time` of names, or over `time` and `fill` of
            shares. It holds at all hours: no shade covers it. Openings that are not named stay as
            in the case: groups close by the rule of the shade or by their schedules.
        drawn : mapping, optional
            Fill, or shares of fills, by opening, in place of what the case draws there: groups
            close over it. The shade of `[shading]` covers its clear parts, glass and holes.

        Returns
        -------
        Result
            As from `drcmitsuba.evaluate`. `total_open` has the groups that close in their first
            state, and openings with fills by the hour as chosen.

        Raises
        ------
        InputError
            An opening or a fill is unknown, shares do not add up to 1, an hour is missing, or the
            shade is no fill of an opening that it covers; fills bring too many sets of surfaces,
            or shares are taken of them.

        Notes
        -----
        Façades of the same elements share their light paths: the difference of two has a smaller
        error than either one. Where fills bring surfaces of their own, the light with a set of
        these is simulated for the first façade that has it.
        """
        run = replace(self.run, seconds=dict(self.run.seconds), ray_counter=Counter())
        with one_blas_thread():
            facade, light = self._facade(choice or {}, drawn or {})
            simulate_scheduled(facade, light, run)
        return recombined(facade, self._summed, light, run, self._notes)

    def illuminance(self, choice: Choice | None = None) -> xr.Dataset:
        """Illuminance of a façade whose openings stay as drawn where the choice names none.

        Parameters
        ----------
        choice : mapping, optional
            As for `evaluate`.

        Returns
        -------
        xr.Dataset
            `total`, `total_se` (time, sensor) [lx], with a dim `channel` where the case is
            coloured.

        Raises
        ------
        InputError
            As for `evaluate`.
        """
        facade, light = self._fixed(choice or {})
        indices = facade.moving.schedule.indices(light.sky["time"])
        return self._illuminance(facade, light, facade.shares(indices))

    def in_states(self, states: np.ndarray | xr.DataArray) -> xr.Dataset:
        """Illuminance with the openings in given fills.

        Parameters
        ----------
        states : np.ndarray or DataArray of int, shape (time, opening)
            Index of the fill of every opening at every time stamp; labels `time` and `opening`, or
            `group`, count where an array has them.

        Returns
        -------
        xr.Dataset
            As from `illuminance`.

        Raises
        ------
        InputError
            Another shape, or an index out of range.
        """
        light, known = self.daylight.alone(), self.groups
        if isinstance(states, xr.DataArray) and "opening" in states.dims:
            states = states.rename(opening="group")
        labels: dict[str, Any] = {"time": light.sky["time"].values, "group": known.names}
        given = in_order(states, labels, "states")
        shape = (light.sky.sizes["time"], len(known))
        if given.shape != shape:
            got = f"the shape {given.shape}"
            raise InputError("states", "shape", got, f"give {shape}: time stamps and openings")
        if given.dtype.kind not in "iu" or (given < 0).any() or (given > known.last).any():
            got, most = "what is no index of a fill", ", ".join(map(str, known.last))
            raise InputError("states", "index", got, f"whole numbers from 0 to {most} by opening")
        facade, light = self._fixed({})
        shares = self.channels[0].shares(given)
        return self._illuminance(facade, light, shares)

    def _illuminance(self, facade: ChosenFacade, light: Daylight, shares: np.ndarray) -> xr.Dataset:
        """`total` and `total_se` [lx] of shares (time, element)."""
        simulate_sets(self.channels, shares, self.run)
        E = facade.illuminance(light, shares)
        mean, error = mean_and_error(E.transpose("replicate", ...).values)
        dims = [dim for dim in E.dims if dim != "replicate"]
        out = xr.Dataset({"total": (dims, mean), "total_se": (dims, error)}, E.coords)
        return describe(out.assign_coords(prepared(self.case).receivers.coordinates.coords))

    def _fixed(self, choice: Choice) -> tuple[ChosenFacade, Daylight]:
        """Façade of a choice whose other openings stay as drawn, at the case's own time stamps."""
        first = {opening: fills[0] for opening, fills in self.fills.items()}
        facade, light = self._facade({**first, **choice}, {})
        return facade, light.alone()

    def _facade(self, choice: Choice, drawn: Choice) -> tuple[ChosenFacade, Daylight]:
        """Façade of a choice, and the daylight that its hours are of."""
        light = self.daylight
        time = light.sky["time"].values
        chosen, first = (ChosenFills.of(self.fills, each, time) for each in (choice, drawn))
        if both := chosen.named & first.named:
            got = f"{self.openings[min(both)]} is in the choice, too"
            raise InputError("drawn", "opening", got, "name it in one of them")
        if first.hourly:
            got = f"fills of {self.openings[min(first.hourly)]} by the hour"
            raise InputError("drawn", "time", got, "give them as a choice, or one for all hours")
        if chosen.hourly:
            light = light.alone()  # the choice knows no other hours
        facade = ChosenFacade.of(
            self.case, self.panes, self.channels, self._marked, light.sky["time"], chosen,
            first.constant, light=self._light, sky=light.every.sky,
        )  # fmt: skip
        words = {"choice": chosen.in_words(self.fills), "drawn": first.in_words(self.fills)}
        asked = {name: text for name, text in words.items() if text}
        origin = json.dumps(json.loads(self._marked["settings"]) | asked, ensure_ascii=False)
        return replace(facade, attributes=facade.attributes | {"settings": origin}), light

    @cached_property
    def _light(self) -> KnownLight | None:
        """Light in the daylight of the case, which all façades share."""
        alike = tuple(light for light in self.channels if isinstance(light, LightByElement))
        if not alike:
            return KnownLight.by_bin(self.channels, self.daylight)
        return KnownLight.of(alike, self.daylight)

    @cached_property
    def _marked(self) -> dict[str, Any]:
        """Attributes of C."""
        return attributes(self.case, self.daylight, self.planned.scope)

    @cached_property
    def _summed(self) -> Plan:
        """Plan that says what a sum over elements leaves out."""
        return self.planned.summed(always=True)

    @cached_property
    def _notes(self) -> list[str]:
        """Notes on the films and the shade, and on a target."""
        return [*notes(self.case), *without_rounds(self.case.accuracy.sensor_goal)]

    def __repr__(self) -> str:
        some = ", ".join(f"{name}: {' | '.join(fills)}" for name, fills in self.fills.items())
        return f"<Elements of {self.case.name!r}: {some}>"

    def _repr_html_(self) -> str:
        """Table of the openings and their fills."""
        from html import escape

        rows = "".join(
            f"<tr><th>{escape(name)}</th><td>{escape(', '.join(fills))}</td></tr>"
            for name, fills in self.fills.items()
        )
        return (
            f"<table><caption>{escape(self.case.name)}, openings and fills</caption>{rows}</table>"
        )


def elements(case: Case | str | Path, fills: Fills = (), stage: Stage = silent) -> Elements:
    """Simulate the light of a case by opening and fill.

    Parameters
    ----------
    case : Case, str or Path
        Case, TOML file, or name of a shipped case. True suns take the place of an adaptive one,
        and a target adds no rounds.
    fills : sequence of str, or mapping of str to sequence of str, optional
        Further fills of all openings, or of some by their names: materials of the case, "hole",
        and, in a room of boxes, "wall". By default what the case itself may put there.
    stage : callable, optional
        Function that shows the stages of the work.

    Returns
    -------
    Elements
        Openings: the groups of the case, and the panes of one material and direction in none.

    Raises
    ------
    InputError
        An opening or a fill is unknown, or memory does not hold so many elements.

    Notes
    -----
    Groups of a model whose states have surfaces of their own, such as a shelf or a tree, are
    openings, too; see `Elements.evaluate`.

    Examples
    --------
    >>> import drcmitsuba
    >>> light = drcmitsuba.elements("corner_office.toml", fills=["hole"])
    >>> light.fills
    {'south': ('glass', 'blind', 'fabric', 'hole'), 'east': ('glass', 'fabric', 'hole')}
    >>> result = light.evaluate({"south": "hole"})
    >>> result.metrics["sDA"]
    {'value': ..., 'low': ..., 'high': ...}
    """
    case = (case if isinstance(case, Case) else load_case(case)).with_true_suns()
    backend.select()
    run = replace(Run.of(case), stage=stage)
    with one_blas_thread():
        with run.timed("sky"):
            light = daylight_and_year(case)
            panes, planned, run = Opened.of(case, fills, light, run)
            accuracy = run.accuracy(case)
        with run.timed("elements") as done:
            bringing = [panes.states.names.index(name) for name in groups_with_surfaces(case)]
            channels = light_with_surfaces(
                case, panes, bringing, light.suns, accuracy, planned.scope, done
            )
    return Elements(case, light, planned, run, panes, channels)
