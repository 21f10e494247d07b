"""Notes for the user on films, shade and photons."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from drcmitsuba.bsdf import advice
from drcmitsuba.case.accuracy import OF_EXTENT, SMALLEST_CELL, Target
from drcmitsuba.case.case import Case
from drcmitsuba.case.colour import Colour
from drcmitsuba.case.model_case import notes_on_groups
from drcmitsuba.colour.bands import Bands
from drcmitsuba.colour.sources import check_sources
from drcmitsuba.colour.tints import Tints
from drcmitsuba.model.materials import BsdfMaterial
from drcmitsuba.plan import panes
from drcmitsuba.plan.reflected import extent_of_rooms
from drcmitsuba.runtime.toml import shortened
from drcmitsuba.scene.daylit import darkness_notes
from drcmitsuba.scene.leaks import crack_notes
from drcmitsuba.scene.materials import film
from drcmitsuba.scene.panes_behind import doubled_notes
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.spaces import box_and_note
from drcmitsuba.scene.surfaces import surfaces_of

OF_BANDS = ("sky", "sun", "spectra", "melanopic_threshold")
"""Keys of `[colour]` that bands alone follow."""
MOST_LOST = 1e-3
"""Part of the photons' flux that may be lost without a note."""
MOST_SMEARED = 0.1


def light_notes(coefficients: Mapping[str, Any]) -> list[str]:
    """Notes on light that is left out, lost or smeared, from the attributes of C."""
    remarks, ledgers = [], json.loads(coefficients.get("photons", "{}"))
    if pairs := coefficients.get("pairs_left_out"):
        remarks.append(
            f"light that the glass of one opening mirrors of another one's is left out for {pairs} "
            "pairs of openings, those of the smaller panes: take fewer fills, tiles or sensors"
        )
    for name, ledger in ledgers.items():
        component, kind = name.rsplit(" ", 1)
        if not component:
            continue
        if kind == "sun" and ledger["emitted"] == 0:
            remarks.append(f"components.{component}: no sun of the period reaches it")
        if ledger["lost"] > MOST_LOST * ledger["emitted"]:
            remarks.append(
                f"components.{component}: {100 * ledger['lost'] / ledger['emitted']:.2g} % of the "
                f"light from the {kind} was still under way when photons were given up and is lost;"
                " raise accuracy.photon_surfaces"
            )
    smear = coefficients.get("photons_smear", 0.0)
    if smear > MOST_SMEARED:
        sent = "what panes send to others and on"
        if any(name.rsplit(" ", 1)[0] for name in ledgers):
            sent = "what components send there straight"
        remarks.append(
            f"the squares around the sensors smear {sent} by "
            f"{100 * smear:.0f} % (RMS); lower accuracy.sensor_square and raise accuracy.photons"
        )
    return remarks


def shade_notes(case: Case) -> list[str]:
    """Note which panes close together, where they lie in several planes."""
    if case.shading is None or case.groups:
        return []
    groups = prepared(case).groups
    closing = zip(groups.facings, groups.states.closable, strict=True)
    sides = list(dict.fromkeys(side for facings, closes in closing if closes for side in facings))
    if len(sides) < 2:
        return []
    facades = f"{', '.join(sides[:-1])} and {sides[-1]}"
    if case.shading.by_space and any(groups.spaces):
        return [f"shading: {facades} of each space close and open each on its own, as in LM-83"]
    if len(groups) > 1 and len(prepared(case).spaces) > 1:
        return [
            f"shading: {facades} close and open each on its own, in all spaces at once; "
            'groups = "spaces" does so in each space'
        ]
    if len(groups) > 1:
        return [f"shading: {facades} close and open each on its own, as in LM-83"]
    return [f"shading: one shade for all clear panes; {facades} close and open together"]


def _target_notes(case: Case) -> list[str]:
    """Note a target that an evaluation does not work toward."""
    goal = case.accuracy.goal
    if goal is None or case.accuracy.sensor_goal is not None:
        return []
    return [f'accuracy.target: "{goal}" is one of `glare`; an evaluation adds no rounds toward it']


def without_rounds(goal: Target | None) -> list[str]:
    """Note a target toward which light that façades share has no rounds; none without one."""
    if goal is None:
        return []
    return [f'accuracy.target: "{goal}": light that façades share has no rounds toward it']


def notes_on_sum(case: Case) -> list[str]:
    """Note what follows the light of one façade, and not a year that is summed over its groups."""
    remarks = without_rounds(case.accuracy.sensor_goal)
    if case.sun.model == "adaptive":
        remarks.append(
            "sun.model: true suns light the hours whose light is summed over groups of panes"
        )
    return remarks


def _space_notes(case: Case) -> list[str]:
    """Note on shades that close by the sun on sensors of spaces that are left out."""
    known, groups = prepared(case), prepared(case).groups
    rooms = known.rooms_of(known.receivers.at()[0])
    if not case.output.spaces or rooms is None:
        return []
    kept = {known.spaces[i].name for i in np.unique(rooms[rooms >= 0])}
    pairs = zip(groups.states.names, groups.spaces, strict=False)  # none where none is told
    names = [name for name, own in pairs if own and kept.isdisjoint(own)]
    if not names:
        return []
    return [
        f"output.spaces: no sun closes the shades of {shortened(', '.join(names))}, since sensors "
        "of their spaces are left out: light that comes from there is that of open shades"
    ]


def _cell_notes(case: Case) -> list[str]:
    """Note on cells that are large beside the rooms, of which sensors then know little."""
    extent, size = extent_of_rooms(case), case.accuracy.cell_size
    least = np.inf if extent is None else float(extent.min())
    if least >= 2 * size or least / OF_EXTENT < SMALLEST_CELL:
        return []
    return [
        f"accuracy.cell_size: cells of {size:g} m in rooms of {least:.2g} m: light of a cell is a "
        f"mean over it; write {least / OF_EXTENT:.2g} or less"
    ]


def colour_notes(case: Case) -> list[str]:
    """Notes on spectra, which are read and checked; without bands, on those that take no part."""
    if not case.colour.wavelengths:
        told, usual = case.colour, Colour()
        named = [key for key in OF_BANDS if getattr(told, key) != getattr(usual, key)]
        return [f"colour: {', '.join(named)} take part with bands = 9 or 27 alone"] * bool(named)
    bands = Bands.of(case.colour.wavelengths)
    check_sources(case, bands)
    return Tints(case, bands).check(surfaces_of(case))


def notes(case: Case) -> list[str]:
    """Notes on the model, on the shade, and on films whose BSDF was scaled down."""
    of_groups = notes_on_groups(case.building, case.groups)
    remarks = [*case.building.notes, *of_groups, *shade_notes(case)]
    remarks += [*prepared(case).sensors.notes, *crack_notes(case), *darkness_notes(case)]
    remarks += doubled_notes(case)
    remarks += [*_target_notes(case), *_cell_notes(case), *_space_notes(case), *colour_notes(case)]
    if case.room is not None and (note := box_and_note(case)[1]):
        remarks.append(note)
    for name, material in panes.of(case, BsdfMaterial).items():
        measured = film(material.file)
        if lacking := advice.dark(measured.file):
            remarks.append(
                f"materials.{name}: {material.file.name} lacks the {' and the '.join(lacking)}: "
                "taken as 0"
            )
        if differs := advice.not_reciprocal(measured.file):
            remarks.append(
                f"materials.{name}: {material.file.name} is not reciprocal, by {differs}: light "
                "the other way differs by so much; the values are taken as they are"
            )
        if measured.largest_albedo > 1:
            remarks.append(
                f"materials.{name}: {material.file.name} sends out up to "
                f"{100 * measured.largest_albedo:.1f} % of the light; scaled down to 100 % there"
            )
    return remarks
