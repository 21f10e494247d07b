"""Which effects a case calls for, and why."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case import BsdfMaterial, Case, DiffuserMaterial, GlazingMaterial
from drcmitsuba.materials import film, lets_through
from drcmitsuba.scene import is_coloured


def plan(
    case: Case, suns: int, closed: int, hours: int, mesh: Mapping[str, float]
) -> dict[str, dict[str, Any]]:
    """List the effects with whether each is simulated and the reason in words.

    Parameters
    ----------
    case : Case
    suns : int
        Suns above the horizon in the period.
    closed, hours : int
        Time stamps with the shade closed, and in all.
    mesh : dict
        `mesh_suns` and `mesh_miss` of an adaptive sun, see `refinement.meshed`.

    Returns
    -------
    dict
        {effect: {"on": bool, "reason": str}}; `missing` is true for what the case calls for and
        the program cannot do.
    """
    panes = {
        side: [case.materials[s.material] for s in f.strips if s.material in case.materials]
        for side, f in case.facade.items()
    }
    glazed = case.glazed
    mirrors = [
        side
        for side, materials in panes.items()
        if any(isinstance(m, GlazingMaterial) and m.reflectance > 0 for m in materials)
    ]
    # The sun that comes in by one façade and is mirrored by the glass of another.
    mirrored = bool(mirrors) and len(glazed) > 1
    films = _films(case)
    with_film = [s for s, ms in panes.items() if any(isinstance(m, BsdfMaterial) for m in ms)]
    scatters = (BsdfMaterial, DiffuserMaterial)
    facing = {s for s, ms in panes.items() if any(isinstance(m, scatters) for m in ms)}
    if case.shading is not None:
        facing |= set(glazed)
    in_turn = bool(with_film) and len(facing) > 1
    scattering = sum(isinstance(m, DiffuserMaterial) for ms in panes.values() for m in ms)
    clear = sum(isinstance(m, GlazingMaterial) for ms in panes.values() for m in ms)
    ground = case.outside.ground_reflectance
    photons = bool(case.standing)
    followed = "is followed by photons" if photons else "is not simulated"
    shaded = "no [shading] in the case"
    if case.shading is not None:
        shaded = f"the shade closes in {closed} of {hours} time stamps"
    return {
        "sky": {"on": True, "reason": f"{len(Patches(case.sky.subdivision)) - 1} patches"},
        "ground": {"on": ground > 0, "reason": f"its reflectance is {ground:g}"},
        "suns": {"on": suns > 0, "reason": _sun_model(case, suns, mesh)},
        "clear_panes": {"on": clear > 0, "reason": f"{clear} clear strips in the façades"},
        "scattering_panes": {"on": scattering > 0, "reason": f"{scattering} diffusing strips"},
        "films": {
            "on": bool(films),
            "reason": f"{len(films)} measured materials: {', '.join(films)}"
            if films
            else "no pane with a measured BSDF",
        },
        "straight_through": _straight_through(case),
        "films_in_turn": {
            "on": in_turn and photons,
            "missing": in_turn and not photons,
            "reason": "light that a film gets from another film or a diffusing pane across the "
            f"room ({', '.join(with_film)}), before it meets a surface, {followed}"
            if in_turn
            else "no film that faces another scattering pane",
        },
        "components": {
            "on": bool(case.standing),
            "reason": "photons through the ports of " + ", ".join(case.standing)
            if case.standing
            else "no component that is geometry",
        },
        "shaded_state": {"on": closed > 0, "reason": shaded},
        "colour": {
            "on": is_coloured(case),
            "reason": "a reflectance differs between channels"
            if is_coloured(case)
            else "all reflectances are grey: one channel",
        },
        "mirrored_light": {
            "on": mirrored and photons,
            "missing": mirrored and not photons,
            "reason": "light that enters by one façade and is mirrored by the glass of another "
            f"({', '.join(mirrors)}) before it meets a surface {followed}"
            if mirrored
            else "no mirroring glass across from another opening",
        },
    }


def _sun_model(case: Case, suns: int, mesh: Mapping[str, float]) -> str:
    """What stands for the suns of a period."""
    told = {
        "true_sun": "each of them simulated",
        "three_phase": "spread over the four nearest patches of the sky",
        "five_phase": "moved to the centres of patches of Reinhart's MF 6",
        "daysim": "between the four nearest of DAYSIM's suns",
    }
    count = f"{suns} suns above the horizon in the period, "
    if case.sun.model != "adaptive":
        return count + told[case.sun.model]
    return (
        f"{count}each of them straight; all other light between {mesh['mesh_suns']:g} suns of a "
        f"mesh, which misses suns in between by {100 * mesh['mesh_miss']:.1f} % (RMS)"
    )


def _films(case: Case) -> dict[str, BsdfMaterial]:
    """The measured materials that the façades or the shade use, by name."""
    used = {s.material for f in case.facade.values() for s in f.strips}
    if case.shading is not None:
        used.add(case.shading.material)
    return {
        name: m
        for name, m in case.materials.items()
        if name in used and isinstance(m, BsdfMaterial)
    }


def _straight_through(case: Case) -> dict[str, Any]:
    """Whether the sun is seen through films, and why."""
    told, views = [], False
    for name, material in _films(case).items():
        found = film(material.file)
        seen = lets_through(material)
        views |= seen
        share = f"{100 * found.share_through:.1f} % of the light that {name} lets through"
        stands = "stands out as a peak" if found.stands_out else "does not stand out"
        chosen = f"straight_through = {material.straight_through!r}"
        told.append(f"{share} goes straight on and {stands} ({chosen}): {'on' if seen else 'off'}")
    return {"on": views, "reason": "; ".join(told) or "no pane with a measured BSDF"}


MOST_LOST = 1e-3
"""Part of the photons' flux that may be given up without a note."""
MOST_SMEARED = 0.1


def photon_notes(coefficients: Mapping[str, Any]) -> list[str]:
    """What is to be known of the photons, from the attributes of C, for the notes of a result."""
    told, ledgers = [], json.loads(coefficients.get("photons", "{}"))
    for name, ledger in ledgers.items():
        component, kind = name.rsplit(" ", 1)
        if not component:
            continue
        if kind == "sun" and ledger["emitted"] == 0:
            told.append(f"components.{component}: no sun of the period reaches it")
        if ledger["lost"] > MOST_LOST * ledger["emitted"]:
            told.append(
                f"components.{component}: {100 * ledger['lost'] / ledger['emitted']:.2g} % of the "
                f"light from the {kind} was still under way when photons were given up and is lost;"
                " raise accuracy.photon_surfaces"
            )
    smear = coefficients.get("photons_smear", 0.0)
    if smear > MOST_SMEARED:
        told.append(
            f"the squares around the sensors smear what components send there straight by "
            f"{100 * smear:.0f} % (RMS); lower accuracy.sensor_square and raise accuracy.photons"
        )
    return told


def notes(case: Case) -> list[str]:
    """What was done to the films' files, for the notes of a result."""
    told = []
    for name, material in _films(case).items():
        found = film(material.file)
        if found.largest_albedo > 1:
            told.append(
                f"materials.{name}: {material.file.name} sends out up to "
                f"{100 * found.largest_albedo:.1f} % of the light; scaled down to 100 % there"
            )
    return told
