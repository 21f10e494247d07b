"""Scenes in which one element, an opening with one fill, lets light in, and their deposits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import BLOCKED
from drcmitsuba.model.materials import DiffuserMaterial, Lambertian, SurfaceMaterial
from drcmitsuba.model.model import areas
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.geometry import normals as unit_normals
from drcmitsuba.scene.materials import lets_through
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_in_state import GroupedPanes
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.elements.mirrored_deposit import MirroredDeposit
from drcmitsuba.transport.elements.mirrored_pairs import MirroredPairs
from drcmitsuba.transport.elements.weights import BESIDES
from drcmitsuba.transport.mirrors.image_suns import ImageSuns
from drcmitsuba.transport.mirrors.planar_mirrors import PlanarMirrors
from drcmitsuba.transport.mirrors.sun_lobes import SunLobes
from drcmitsuba.transport.photons.tracer import PhotonTracer


@dataclass(frozen=True)
class Element:
    """Opening with one fill, all others blocked, or the light `BESIDES`."""

    number: int
    """Number among the fills of all openings, opening by opening, or `BESIDES`; pairs follow."""
    bins: np.ndarray
    """Bins of its light among all labels, int, shape (own bin,)."""
    deposit: Deposit | None = None
    """Deposit of ground, sky and the suns that shine on it; None where the fill is opaque."""
    sun_samples: int = 0
    """Directions from a sensor to every sun; 0 where suns do not shine straight."""
    photons: PhotonTracer | None = None
    """Photons, where components deviate its light."""
    part: float = 1.0
    """Part of the area of all openings that its own takes; 1 of the light `BESIDES`."""
    is_mirrored: bool = False
    """Whether its light is what one of a pair of elements mirrors, see `MirroredPairs`."""

    @property
    def is_opaque(self) -> bool:
        """Whether no light comes in by its fill."""
        return self.deposit is None

    @property
    def scatters(self) -> bool:
        """Whether its fill sends light to sensors that comes not straight."""
        light = self.deposit
        return light is not None and bool(light.films or light.patches or self.photons)


def elements_of_case(
    case: Case, openings: PaneGroups, panes: Sequence[GroupedPanes], suns: Suns,
    points: np.ndarray, normals: np.ndarray, accuracy: Accuracy, effects: EnabledEffects,
    channel: int, wanted: Mapping[int, np.ndarray] | None = None,
) -> list[Element]:  # fmt: skip
    """Elements of a case, the light that passes no opening first.

    Parameters
    ----------
    panes : sequence of GroupedPanes
        Panes of the openings.
    case, openings, suns, points, normals, accuracy, effects, channel
        As for `ElementTrace.of`.
    wanted : mapping of int to np.ndarray of bool, shape (sun,), optional
        Suns of each element that is asked for; by default all suns of all elements.

    Raises
    ------
    InputError
        A pane outside of an opening has the material of one of its fills.
    """
    subdivision, groups = case.sky.subdivision, openings.states
    sky_bins, shining = len(Patches(subdivision)), effects.enabled_suns(suns)
    radius, elements = np.sin(np.radians(suns.diameter) / 2), []
    area = sum(_area(each) for each in panes)
    fills = [(g, s) for g, of in enumerate(groups.states) for s in range(len(of))]
    for number, (opening, fill) in [(BESIDES, (-1, BLOCKED)), *enumerate(fills)]:
        mask, mine = shining, [each for each in panes if each.group == opening]
        if number != BESIDES:
            if wanted is not None and number not in wanted:
                continue
            mask = shining if wanted is None else shining & wanted[number]
            is_dark = all(isinstance(each.materials[fill], Lambertian) for each in mine)  # or none
            if is_dark or not openings.stands(opening, fill):
                elements.append(Element(number, np.arange(sky_bins)))
                continue
        indices = [fill if g == opening else BLOCKED for g in range(len(groups))]
        world = scene.load(case, groups.label(indices), channel, effects, openings)
        if number != BESIDES and not _mirrors_suns(world):
            outward = -unit_normals(np.concatenate([each.quads for each in mine]))
            mask = mask & ((suns.directions @ outward.T) > -radius).any(axis=1)
        materials = {material for each in mine for material in each.materials}
        count = sum(len(each.quads) for each in mine)
        parts = tuple(_from_outside(case, part, materials, count) for part in world.parts)
        bins = np.concatenate([np.arange(sky_bins), sky_bins + np.flatnonzero(mask)])
        directions = suns.where(mask).directions
        light = Deposit.of(
            replace(world, parts=parts), directions, suns.diameter, subdivision, accuracy
        )
        if number != BESIDES:  # else tiles would share one pattern of points, and so its errors
            own = launch_seed(accuracy.seed, Stream.OPENINGS, opening)
            light = replace(light, pane_seed=own)
        photons = PhotonTracer.of(
            light.scene, points, normals, light.suns, suns.diameter, subdivision, accuracy
        )
        samples = accuracy.sensor_sun_samples if suns.straight else 0
        part = sum(map(_area, mine)) / area if mine else 1.0
        elements.append(Element(number, bins, light, samples, photons, part))
    return elements


def elements_of_pairs(
    pairs: MirroredPairs, elements: Sequence[Element], panes: Sequence[GroupedPanes],
    first: Sequence[int], wanted: Mapping[int, np.ndarray] | None = None,
) -> list[Element]:  # fmt: skip
    """Light of pairs, whose numbers follow those of all elements.

    Parameters
    ----------
    elements : sequence of Element
        Elements that are asked for.
    first : sequence of int, shape (opening + 1,)
        First element of every opening, and the number of all.
    panes, wanted
        As for `elements_of_case`.
    """
    by_number, out = {each.number: each for each in elements}, []

    @cache
    def mirrors_of(element: int) -> PlanarMirrors | None:
        light, mine = by_number[element].deposit, _filled(panes, first, element)
        quads = np.concatenate([each.quads for each, _ in mine])
        return None if light is None else PlanarMirrors.of_panes(light.scene, quads)

    for k, (m, e) in enumerate(zip(pairs.mirrors, pairs.passed, strict=True)):
        mirror, lit, number = by_number.get(m), by_number.get(e), first[-1] + k
        if mirror is None or lit is None:
            continue
        mirrors, theirs = mirrors_of(m), _filled(panes, first, e)
        if mirrors is None or lit.deposit is None:
            out.append(Element(number, min(mirror.bins, lit.bins, key=len)))
            continue
        base, bins = lit.deposit, lit.bins
        if wanted is not None:
            kept, sky = wanted[m][bins[base.bins[0] :] - base.bins[0]], base.bins[0]
            bins, suns = np.concatenate([bins[:sky], bins[sky:][kept]]), base.suns[kept]
            films = None if base.films is None else base.films.with_suns(suns, base.diameter)
            base = replace(base, suns=suns, films=films)
        images = ImageSuns(mirrors.scene, mirrors, base.scene)
        is_clear = any(material is None or lets_through(material) for _, material in theirs)
        light = MirroredDeposit.shown(images, base, number, is_clear)
        out.append(Element(number, bins, light, lit.sun_samples, part=lit.part, is_mirrored=True))
    return out


def _filled(
    panes: Sequence[GroupedPanes], first: Sequence[int], element: int
) -> list[tuple[GroupedPanes, SurfaceMaterial | None]]:
    """Panes of an element, and their material there."""
    return [
        (each, each.materials[element - first[each.group]])
        for each in panes
        if first[each.group] <= element < first[each.group + 1]
    ]


def _area(panes: GroupedPanes) -> float:
    """Area of panes [m²]."""
    return float(areas(np.reshape(panes.quads, (-1, 4, 3))).sum())


def _mirrors_suns(world: scene.Scene) -> bool:
    """Whether a sun behind an opening may reach it by way of mirrors or components."""
    return bool(world.ports or SunLobes.of(world)) or ImageSuns.of(world) is not None


def _from_outside(
    case: Case, part: scene.ScenePart, materials: set[SurfaceMaterial | None], count: int
) -> scene.ScenePart:
    """Pane that reflects nothing: the paths count what it reflects.

    An opening has `count` quads: a part with more of them holds other panes of the same material.
    """
    if isinstance(part.material, DiffuserMaterial) and part.material in materials:
        if len(part.quads) > count:
            got = f"a pane outside of the openings has the material of a fill, {part.name}"
            remedy = "join it to a group, or give it another transmittance"
            raise InputError(case.source, "groups", got, remedy)
        bare = {"reflectance": 0.0, "outer_reflectance": 0.0}
        return replace(part, material=part.material.model_copy(update=bare))
    return part
