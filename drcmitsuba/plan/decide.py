"""Which effects a case calls for: one function each, with the quantity that decides it."""

from __future__ import annotations

import numpy as np
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.case import Case
from drcmitsuba.case.sensors import PointSensors, Sensors
from drcmitsuba.case.sun import Adaptive, ThreePhase, TrueSun
from drcmitsuba.model.materials import BsdfMaterial, DiffuserMaterial
from drcmitsuba.plan import panes
from drcmitsuba.plan.effect import Effect
from drcmitsuba.plan.facts import Facts
from drcmitsuba.scene.components import PlacedComponent
from drcmitsuba.scene.materials import albedo, film, is_mirroring_glass, lets_through
from drcmitsuba.scene.panes_behind import mirroring_before
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.scene import is_coloured
from drcmitsuba.transport.mirrors.planar_mirrors import is_planar_mirror, is_rough_mirror

OF_A_BAND = 0.15
"""Time of a band per time of the year by luminance; of the classroom."""


def sky(facts: Facts) -> Effect:
    """Patches of the sky: on where the room has an opening and some patch has a luminance."""
    L = facts.light.every.sky
    is_bright = (L["sky"].values[:, 1:] > 0).any(axis=1)
    if isinstance(facts.case.sun, ThreePhase):  # the sun is among the patches
        is_bright |= L["sun"].values > 0
    bright = int(is_bright.sum())
    if facts.shut:
        return Effect(False, "the room has no opening")
    count = len(Patches(facts.case.sky.subdivision)) - 1
    reason = f"{count} patches; the sky is bright in {bright} of {facts.stamps} time stamps"
    return Effect(bright > 0, reason, {"bright_hours": bright})


def ground(facts: Facts) -> Effect:
    """Light of the ground below the horizon."""
    reflectance = facts.case.outside.ground_reflectance
    if reflectance == 0:
        return Effect(False, "its reflectance is 0")
    if facts.shut:
        return Effect(False, "the room has no opening")
    if facts.surrounded:
        stands = facts.outside or facts.case.standing
        who = "things stand outside" if stands else "faces of the model look outside"
        return Effect(True, f"its reflectance is {reflectance:g}, and {who}")
    if facts.reach is None:
        if not isinstance(facts.case.sensors, Sensors):
            return Effect(True, f"its reflectance is {reflectance:g}, and sensors may face it")
        return Effect(False, "the sensors look up and nothing stands around them")
    lowest = float(facts.reach.normals[:, 2].min())
    reason = f"its reflectance is {reflectance:g}; lowest n·z of an opening = {lowest:.2f}"
    if lowest > 1 - 1e-9:
        reason = f"no opening sees it: lowest n·z = {lowest:.2f}, all face straight up"
    return Effect(lowest <= 1 - 1e-9, reason, {"lowest_nz": lowest})


def suns(facts: Facts) -> Effect:
    """Suns that shine and can get in."""
    reached, count = facts.reached, len(facts.light.suns.labels)
    into = int(reached.mask.sum())
    quantities = {"suns": count, "reaching": into, "largest_ns": round(reached.largest, 4)}
    if facts.shut:
        return Effect(False, "the room has no opening", quantities)
    shining = int((facts.light.every.sky["sun"].values > 0).sum())
    if shining == 0:
        return Effect(False, "no sun of the period has a radiance", quantities)
    if isinstance(facts.case.sun, ThreePhase):
        reason = f"{shining} suns, each spread over the four nearest patches of the sky"
        return Effect(True, reason, quantities)
    reason = f"{into} of {count} suns {_stand_for(facts.case)} can get in"
    if into == 0 and count:
        reason = f"no opening sees the sun: largest n·s = {reached.largest:.2f}"
        if reached.hidden:
            reason = f"what stands outside hides all {reached.hidden} suns before an opening"
    elif into < count:
        reason += f"; {reached.behind} are behind every opening"
        reason += f" and {reached.hidden} hidden" if reached.hidden else ""
    return Effect(into > 0, reason, quantities)


def _stand_for(case: Case) -> str:
    """Name the suns that stand for those of the period."""
    return {
        "true_sun": "of the time stamps",
        "adaptive": "of the time stamps (straight; all other light is between suns of a mesh)",
        "five_phase": "in the centres of patches of Reinhart's MF 6",
        "daysim": "that DAYSIM takes",
    }[case.sun.model]


def dark_hours(facts: Facts) -> Effect:
    """Time stamps whose sun is up without radiance, or that have no light at all."""
    L = facts.light.sky
    up = facts.light.sun["solar_zenith"].values < 90
    without = int((up & (L["sun"].values == 0)).sum())
    black = int((~(L["sky"].values > 0).any(axis=1) & (L["sun"].values == 0)).sum())
    reason = (
        f"in {without} of {facts.hours} time stamps the sun is up without radiance, "
        f"{black} have no light at all: none of their suns is needed"
    )
    return Effect(False, reason, {"without_sun": without, "black": black})


def _power(names: dict[str, float], what: str) -> Effect:
    """Decide by the share of light [–] that each material of one kind sends on."""
    sending = [name for name, share in names.items() if share > 0]
    if sending:
        return Effect(True, f"{what}: {', '.join(sending)}")
    reason = f"{what} send nothing on: {', '.join(names)}" if names else f"no {what}"
    return Effect(False, reason)


def clear_panes(facts: Facts) -> Effect:
    """Holes and clear glass of the façades."""
    case = facts.case
    clear = (name for name in panes.used(case) if case.is_clear(name))
    names = {n: 1.0 if n == "open" else albedo(case.materials[n]) for n in clear}
    return _power(names, "clear glass and holes")


def scattering_panes(facts: Facts) -> Effect:
    """Panes and shades that scatter evenly (Lambertian)."""
    names = {name: albedo(m) for name, m in panes.of(facts.case, DiffuserMaterial).items()}
    return _power(names, "diffusing panes")


def films(facts: Facts) -> Effect:
    """Panes and shades with a measured BSDF."""
    names = {name: albedo(m) for name, m in panes.of(facts.case, BsdfMaterial).items()}
    return _power(names, "panes with a measured BSDF")


def straight_through(facts: Facts) -> Effect:
    """Views straight through films."""
    reasons, views = [], False
    for name, material in panes.of(facts.case, BsdfMaterial).items():
        measured, seen = film(material.file), lets_through(material)
        views |= seen
        share = f"{100 * measured.share_through:.1f} % of the light that {name} lets through"
        stands = "stands out as a peak" if measured.stands_out else "does not stand out"
        chosen = f"straight_through = {material.straight_through!r}"
        reasons.append(f"{share} goes straight on and {stands} ({chosen})")
    return Effect(views, "; ".join(reasons) or "no panes with a measured BSDF")


def components(facts: Facts) -> Effect:
    """Mirrors, solids and pipes, through which photons are followed."""
    if not facts.components:
        return Effect(False, "no component that is geometry")
    mirroring = [c.name for c in facts.components if _mirrors(c)]
    if not mirroring:
        names = ", ".join(c.name for c in facts.components)
        return Effect(False, f"components send nothing on: {names}")
    imaged = [c.name for c in facts.components if c.name in mirroring and _has_images(c)]
    others = ", ".join(name for name in mirroring if name not in imaged)
    parts = [f"photons through the ports of {others}"] if others else []
    if imaged:
        named = ", ".join(imaged)
        parts.append(f"images and lobes in {named} (see mirrors), photons for what these leave out")
    return Effect(True, "; ".join(parts))


def _has_images(component: PlacedComponent) -> bool:
    """Whether all that a component sends on it mirrors in few planes."""
    sends = [s for s in component.surfaces if albedo(s.material) > 0]
    return all(is_planar_mirror(s) or is_rough_mirror(s) for s in sends)


def _mirrors(component: PlacedComponent) -> bool:
    """Whether a component sends light on; a black component only casts shadows."""
    return any(albedo(s.material) > 0 for s in component.surfaces)


def pane_to_pane(facts: Facts) -> Effect:
    """Light that a pane sends to another one across the room, before it meets a surface."""
    films, reasons = _from_pane_to_pane(facts)
    if not reasons:
        return Effect(False, "no mirroring glass or film across from another opening")
    if isinstance(facts.case.sun, Adaptive):
        return Effect(
            False,
            f"{'; '.join(reasons)}: light from pane to pane is not simulated with an adaptive sun",
            missing=True,
        )
    how = "photons follow it" if films else "images of the suns, rays to the sky"
    return Effect(True, f"{'; '.join(reasons)}: {how}")


def _from_pane_to_pane(facts: Facts) -> tuple[bool, list[str]]:
    """Whether films face other scattering panes, and what sends light from pane to pane."""
    case, sides_of = facts.case, panes.used(facts.case)
    measured = panes.of(case, BsdfMaterial)
    scattering = {**measured, **panes.of(case, DiffuserMaterial)}
    with_film = {side for name in measured for side in sides_of[name]}
    facing = {side for name in scattering for side in sides_of[name]}
    mirrors = {
        side
        for name, sides in sides_of.items()
        for side in sides
        if is_mirroring_glass(case.materials.get(name))
    }
    in_turn = bool(with_film) and len(facing) > 1
    above = any(c.is_open for c in facts.components)
    glazed = {side for sides in sides_of.values() for side in sides}
    mirrored = bool(mirrors) and len(glazed) + above > 1
    before = mirroring_before(case)
    reasons: list[str] = []
    if in_turn:
        reasons.append(f"films ({', '.join(sorted(with_film))}) face other scattering panes")
    if mirrored:
        reasons.append(f"glass that mirrors ({', '.join(sorted(mirrors))}) faces another opening")
    if before:
        reasons.append(f"panes that scatter stand before glass that mirrors ({', '.join(before)})")
    return in_turn, reasons


def obstructions(facts: Facts) -> Effect:
    """Furniture outside of the room."""
    pieces = facts.outside
    if not pieces:
        return Effect(False, "nothing stands outside of the room")
    return Effect(
        True, f"outside stand: {', '.join(dict.fromkeys(pieces))}", {"pieces": len(pieces)}
    )


def shaded_state(facts: Facts) -> Effect:
    """Whether the shade may close, by an upper bound of the direct sun on the sensors."""
    case = facts.case
    groups = prepared(case).groups.states
    if not len(groups):
        return Effect(False, "no [shading] and no [groups] in the case")
    if case.shading is not None and not case.groups and facts.shadeless:
        return Effect(False, "there is no clear pane that it could cover")
    scheduled = [name for name, group in case.groups.items() if group.schedule is not None]
    if scheduled:
        verb = "follows" if len(scheduled) == 1 else "follow"
        return Effect(True, f"{', '.join(scheduled)} {verb} a schedule")
    threshold, area = case.shade_rule
    if area == 0:
        return Effect(True, "shades close at all hours: their rule asks for no sensor in the sun")
    if not isinstance(case.sun, TrueSun | Adaptive):
        hours = int((facts.light.every.sky["sun"].values > 0).sum())
        reason = (
            f"the sun shines in {hours} of {facts.stamps} time stamps, where its model places it"
        )
        return Effect(hours > 0, reason, {"may_close": hours})
    most, hours = most_direct(facts)
    reason = f"the sun puts at most {most:.0f} lx on a sensor, the shade closes at {threshold:g}"
    if hours:
        reason = (
            f"the sun may put {threshold:g} lx on sensors in {hours} of {facts.stamps} time stamps"
        )
    return Effect(hours > 0, reason, {"may_close": hours})


def most_direct(facts: Facts) -> tuple[float, int]:
    """Bound of the direct sun on horizontal sensors [lx], and number of hours that may close."""
    case = facts.case
    through = [1.0 if n == "open" else albedo(case.materials[n]) for n in panes.used(case)
               if n == "open" or n in case.materials]  # fmt: skip
    factor = max(through, default=1.0)
    # Mirrors, and glass across the room, may add to it.
    bends = bool(case.standing) or pane_to_pane(facts).on or case.effects.pane_to_pane == "all"
    normal = facts.light.every.sky["direct_normal_illuminance"].values
    z = facts.light.every.sun["direction"].values[:, 2]
    if isinstance(case.sensors, PointSensors):  # of any normal
        z = np.ones_like(z)
    bound = normal * np.clip(z + np.radians(case.outside.sun_diameter), 0, 1) * factor
    if facts.reach is not None:
        directions = facts.light.every.sun["direction"].values
        bound = bound * facts.reach.visible(directions, case.outside.sun_diameter).mask
    closes = bound > 0 if bends else bound >= case.shade_rule[0]
    return float(bound.max(initial=0)), int(closes.sum())


def colour(facts: Facts) -> Effect:
    """Colour channels."""
    bands = facts.case.colour.bands
    if isinstance(bands, int):
        again = f"{bands} bands follow, which take {OF_A_BAND * (bands + 1):.1f} times its time"
        return Effect(True, f"the year goes by luminance; {again}")
    if bands == "luminance":
        return Effect(False, "[colour] asks for luminance")
    if bands == "rgb":
        return Effect(True, "[colour] asks for three channels")
    if is_coloured(facts.case):
        return Effect(True, "a reflectance differs between channels: three channels")
    return Effect(False, "all reflectances are grey: one channel")


def pictures(facts: Facts) -> Effect:
    """Pictures of the results."""
    return Effect(True, "plans and monthly plots; `render` shows views")


def gradients(facts: Facts) -> Effect:
    """Derivatives of the metrics."""
    whose = "; [design] is for optimise" if facts.case.design is not None else ""
    return Effect(False, f"an evaluation asks for no derivative{whose}")
