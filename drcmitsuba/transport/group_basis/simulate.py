"""From a case to its basis of groups of panes.

case ─ grouped_panes ─► panes by group, with their materials in every state
     ─ GroupMarks ────► paths G₀ and G_m, one set for all states
     ─ Deposit ───────► S, D of every element, the other groups blocked; less S₀, D₀, all blocked

The random numbers of all deposits are the same, so that light that passes no grouped pane cancels.
Light that passes two grouped panes in turn before any diffuse reflection, as through a corner of
two façades, is left out; so is light that clear glass mirrors from pane to pane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import BLOCKED, HIDDEN, GroupStates
from drcmitsuba.model.materials import DiffuserMaterial, SurfaceMaterial
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.runtime.toml import shortened
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.geometry import normals as unit_normals
from drcmitsuba.scene.geometry import origin
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_in_state import GroupedPanes, grouped_panes, groups_with_surfaces
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import Replicate
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.diffusing_panes import PanePatches
from drcmitsuba.transport.films import Films
from drcmitsuba.transport.gather_blocks import Gathered, lit_and_shining
from drcmitsuba.transport.group_basis.basis import BESIDES, ElementLight, GroupBasis
from drcmitsuba.transport.group_basis.marks import MOST_ELEMENTS, GroupMarks
from drcmitsuba.transport.launch_size import PATHS, SENSORS
from drcmitsuba.transport.marked_paths import MarkedPaths
from drcmitsuba.transport.photons import PhotonTracer

FULL = 0.7
"""Share of lit cells above which dark ones are not worth sparing."""
MOST_BYTES = 12 << 30
"""Largest memory of a basis [bytes]."""


class _Source(NamedTuple):
    """Scene in which one element lets light in, with the suns that shine on it."""

    element: int
    scene: scene.Scene
    suns: Suns
    bins: np.ndarray
    """Bins of its light among the labels of the basis."""


def compute(
    case: Case, suns: Suns, accuracy: Accuracy, effects: EnabledEffects, *,
    channel: int = -1, progress: Progress = lambda share: None,
) -> GroupBasis:  # fmt: skip
    """Compute the coefficients of every group of panes in every state.

    Parameters
    ----------
    case : Case
    suns : Suns
    accuracy : Accuracy
    effects : EnabledEffects
        Effects that are simulated; light from pane to pane is not, beside what diffusing panes and
        films reflect, as if it came from all directions alike.
    channel : int
        Colour channel, −1 for luminance.
    progress : callable
        Takes the share of the work that is done.

    Returns
    -------
    GroupBasis
        Coefficients [sr].

    Raises
    ------
    InputError
        The case has no groups, or the basis is too large.
    """
    if case.standing:
        got = f"a sum over groups of panes counts no light by way of {shortened(case.standing[0])}"
        remedy = "take fewer states, which are simulated one by one"
        raise InputError(case.source, "components", got, remedy)
    _refuse_own_shades(case)
    effects = replace(effects, pane_to_pane=False)
    groups, panes = PaneGroups.of(case).states, grouped_panes(case, effects)
    if not panes:
        raise InputError(case.source, "groups", "there is none", "add [groups] or [shading]")
    first = np.cumsum([0, *(len(states) for states in groups.states)])
    if first[-1] > MOST_ELEMENTS:
        got = f"{first[-1]} states of all groups"
        raise InputError(case.source, "groups", got, f"take at most {MOST_ELEMENTS} together")
    points, normals = sensor_points(case)
    hidden = scene.load(case, groups.label([HIDDEN] * len(groups)), channel, effects)
    marks = GroupMarks(panes, first, channel, effects.beyond)
    shapes = {f"shape{i}": shape for i, shape in enumerate((*hidden.full.shapes(), marks.mesh))}
    corners = np.concatenate([hidden.corners, *(each.quads.reshape(-1, 3) for each in panes)])
    full = mi.load_dict({"type": "scene", **shapes}, optimize=False)
    world = replace(hidden, full=full, corners=corners)
    gathered = Gathered.of(
        world, points, normals, accuracy, block=SENSORS, lanes=PATHS, marks=marks
    )
    paths = MarkedPaths(gathered, len(points))
    labels = (*Patches(case.sky.subdivision).labels, *suns.labels)
    sources = _sources(case, groups, panes, suns, effects, channel, len(labels))
    _check_size(case, accuracy, sources, len(points) + paths.blocks)
    lights = {
        source.element: ElementLight(
            source.bins,
            np.empty((accuracy.replicates, len(source.bins), len(points)), np.float32),
            np.empty((accuracy.replicates, len(source.bins), paths.blocks), np.float32),
        )
        for source in sources
    }
    deposits = [_deposit(case, source, points, normals, accuracy) for source in sources]
    for r in range(accuracy.replicates):
        matrix = paths.matrix(r) if gathered.cells.count else None
        for i, (source, (base, photons)) in enumerate(zip(sources, deposits, strict=True)):
            light = lights[source.element]
            _fill(light, r, base, photons, paths, matrix, points, normals)
            progress((r + (i + 1) / len(sources)) / accuracy.replicates)
        _subtract(lights, r)
    return GroupBasis(
        groups=groups,
        positions=points + origin(case),
        labels=labels,
        sky_bins=len(labels) - len(suns.labels),
        besides=lights[BESIDES],
        elements=tuple(lights[e] for e in range(int(first[-1]))),
        marked=paths.marked(),
    )


def _sources(
    case: Case, groups: GroupStates, panes: Sequence[GroupedPanes], suns: Suns,
    effects: EnabledEffects, channel: int, bins: int,
) -> list[_Source]:  # fmt: skip
    """Scenes of all elements, the one with all groups blocked first."""
    sky_bins = bins - len(suns.labels)
    shining = effects.enabled_suns(suns)
    radius, sources, element = np.sin(np.radians(suns.diameter) / 2), [], BESIDES
    states = [
        (None, BLOCKED),
        *((g, s) for g, of in enumerate(groups.states) for s in range(len(of))),
    ]
    for group, state in states:
        mask = shining
        if group is not None:
            mine = [each for each in panes if each.group == group]
            outward = -unit_normals(np.concatenate([each.quads for each in mine]))
            mask = shining & ((suns.directions @ outward.T) > -radius).any(axis=1)
        indices = [state if g == group else BLOCKED for g in range(len(groups))]
        world = scene.load(case, groups.label(indices), channel, effects)
        materials = {m for each in panes if each.group == group for m in each.materials}
        count = sum(len(each.quads) for each in panes if each.group == group)
        parts = tuple(_from_outside(case, part, materials, count) for part in world.parts)
        world = replace(world, parts=parts)
        at = np.concatenate([np.arange(sky_bins), sky_bins + np.flatnonzero(mask)])
        sources.append(_Source(element, world, suns.where(mask), at))
        element += 1
    return sources


def _refuse_own_shades(case: Case) -> None:
    """Refuse groups of a model whose states change more than panes to the outside."""
    for group in groups_with_surfaces(case)[:1]:
        got = "its states have surfaces of their own"
        remedy = "take fewer states, which are simulated one by one"
        raise InputError(case.source, f"groups.{group}", got, remedy)


def _from_outside(
    case: Case, part: scene.Part, materials: set[SurfaceMaterial | None], count: int
) -> scene.Part:
    """Pane that reflects nothing into the room: the paths count what it reflects.

    A group has `count` quads: a part with more of them holds other panes of the same material.
    """
    if isinstance(part.material, DiffuserMaterial) and part.material in materials:
        if len(part.quads) > count:
            got = f"a pane without a group has the material of a state, {part.name}"
            remedy = "join it to a group, or give it another transmittance"
            raise InputError(case.source, "groups", got, remedy)
        return replace(part, material=part.material.model_copy(update={"reflectance": 0.0}))
    return part


def _check_size(case: Case, accuracy: Accuracy, sources: Sequence[_Source], receivers: int) -> None:
    """Refuse a basis that would not fit in memory."""
    size = 4 * accuracy.replicates * receivers * sum(len(source.bins) for source in sources)
    if size > MOST_BYTES:
        got = f"{size / 2**30:.0f} GiB of coefficients by group and state"
        remedy = "take fewer sensors, states, replicates or time stamps"
        raise InputError(case.source, "groups", got, remedy)


def _deposit(
    case: Case, source: _Source, points: np.ndarray, normals: np.ndarray, accuracy: Accuracy
) -> tuple[Deposit, PhotonTracer | None]:
    """Deposit of an element, and photons where components deviate its light."""
    world, suns, size = source.scene, source.suns, 2 * accuracy.cell_size
    subdivision = case.sky.subdivision
    panes = [panes.quads for panes in world.scattering]
    patches = PanePatches.of(panes, size) if panes else None
    films = Films.of(world, size, suns.directions, suns.diameter)
    base = Deposit(world, suns.directions, suns.diameter, subdivision, accuracy, patches, films)
    photons = PhotonTracer.of(
        world, points, normals, suns.directions, suns.diameter, subdivision, accuracy
    )
    return base, photons


def _fill(
    light: ElementLight, r: int, base: Deposit, photons: PhotonTracer | None, paths: MarkedPaths,
    matrix: mi.TensorXf | None, points: np.ndarray, normals: np.ndarray,
) -> None:  # fmt: skip
    """Write one replicate of an element's light; without cells there is no matrix."""
    replicate, gathered = Replicate(r, base.lit(r)), paths.gathered
    if photons is not None:
        seed = launch_seed(base.accuracy.seed, Stream.PHOTONS, r)
        replicate.landed = photons.traced(seed, lambda share: None)
    if matrix is not None:
        replicate.meet(gathered.drawn[r], gathered.cells.keys)
        assert replicate.cells is not None
        D = replicate.cells
        light.total[r] = np.concatenate([_sent(matrix, part) for part in D], axis=1).T
        light.blocks[r] = np.concatenate([paths.means(part).numpy() for part in D], axis=1).T
    else:
        light.total[r], light.blocks[r] = 0, 0
    samples = base.accuracy.sensor_sun_samples
    for here in gathered.blocks:
        p, n = flat(points[here]), flat(normals[here])
        within = None if gathered.within is None else mi.Bool(gathered.within[here])
        light.total[r][:, here] += replicate.sensors(p, n, here, samples, within)[1].T


def _sent(matrix: mi.TensorXf, D: mi.TensorXf) -> np.ndarray:
    """Light that cells send on, (sensor, bin) [sr]; cells and bins without light are spared."""
    (sensors, cells), bins = matrix.shape, D.shape[1]
    out = np.zeros((sensors, bins), np.float32)
    if 0 in D.shape:
        return out
    lit, shining = lit_and_shining(D)
    n_lit, n_shining = dr.width(lit), dr.width(shining)
    if n_lit == 0:
        return out
    if n_lit > FULL * cells:
        return np.asarray((matrix @ D).numpy())
    few, many = (dr.opaque(mi.UInt32, n) for n in (n_lit, n_shining))
    entry = dr.arange(mi.UInt32, sensors * n_lit)
    column = dr.gather(mi.UInt32, lit, entry % few)
    G = dr.gather(mi.Float, matrix.array, entry // few * dr.opaque(mi.UInt32, cells) + column)
    entry = dr.arange(mi.UInt32, n_lit * n_shining)
    row = dr.gather(mi.UInt32, lit, entry // many) * dr.opaque(mi.UInt32, bins)
    d = dr.gather(mi.Float, D.array, row + dr.gather(mi.UInt32, shining, entry % many))
    sent = mi.TensorXf(G, (sensors, n_lit)) @ mi.TensorXf(d, (n_lit, n_shining))
    out[:, shining.numpy()] = sent.numpy()
    return out


def _subtract(lights: dict[int, ElementLight], r: int) -> None:
    """Take the light that passes no grouped pane out of the elements."""
    besides = lights[BESIDES]
    for element, light in lights.items():
        if element != BESIDES:
            at = np.searchsorted(besides.bins, light.bins)
            light.total[r] -= besides.total[r, at]
            light.blocks[r] -= besides.blocks[r, at]
