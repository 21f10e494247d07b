r"""From a room to its façade basis: the coefficients of every element, in one simulation.

.. math:: C(a) = \sum_e a_e \, (S_e + G_0 D_e) + G_r(a) \sum_e a_e D_e

with a the composition (the share of its tile that every element e, one tile filled with one
material, fills), S and D the deposit on sensors and cells that came in by the element, and G₀ the
paths that never met the façade from inside. Paths G_r that did meet it store which elements they
met; their weight is a product of shares (`facade.Meetings`). They carry some per cent of the light
and take D as the mean over blocks of cells, `marked_paths.BLOCK` cells along each edge.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.launch_size import PATHS
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.scene import scene
from drcmitsuba.scene.geometry import Surface, rotation
from drcmitsuba.scene.geometry import normals as unit_normals
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.surfaces import Enclosure, surfaces_of
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.facade_basis.basis import Basis, Returned
from drcmitsuba.transport.facade_basis.facade import Meetings, Palette, Tiles
from drcmitsuba.transport.facade_basis.tiling import Wall, wall_around
from drcmitsuba.transport.facade_basis.views import Receivers, TiledRoom, scattered, straight
from drcmitsuba.transport.gather.blocks import Gathered
from drcmitsuba.transport.gather.marked_paths import MarkedPaths
from drcmitsuba.transport.light.irradiance import Irradiance

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

MOST_BYTES = 8 << 30
"""Largest memory of a basis [bytes]."""


def compute(
    wall: Wall, tiles: Tiles, palette: Palette, suns: Suns, accuracy: Accuracy, *,
    groups: int | None = None, subdivision: int = 1, progress: Progress = lambda share: None,
) -> Basis:  # fmt: skip
    """Compute the basis of a façade.

    Parameters
    ----------
    wall : Wall
    tiles : Tiles
    palette : Palette
        Materials that the tiles may be filled with.
    suns : Suns
    accuracy : Accuracy
    groups : int, optional
        Number of independent results to keep, for standard errors; a divisor of the number of
        replicates. By default each replicate is kept.
    subdivision : int
        Reinhart's factor MF.
    progress : callable
        Takes the share of the work that is done.

    Returns
    -------
    Basis
        Coefficients of every element [sr].

    Raises
    ------
    InputError
        The case is coloured, has windows in other sides or surfaces outside its room, or is too
        large.

    Notes
    -----
    D leaves out light that a film gets from the room's side: behind one façade there is none.
    """
    groups = accuracy.replicates if groups is None else groups
    assert accuracy.replicates % groups == 0
    points, normals = sensor_points(wall.case)
    room, walls = _room(wall, tiles, palette)
    before = suns.where(_before_facade(tiles, suns))
    labels = (*Patches(subdivision).labels, *before.labels)
    elements = np.flatnonzero((palette.allowed & palette.lets_in).ravel())
    size = memory(wall, tiles, palette, suns, accuracy, groups=groups, subdivision=subdivision)
    if size > MOST_BYTES:
        got = f"{size / 2**30:.0f} GiB of coefficients by tile, and of light paths"
        remedy = "take fewer sensors, tiles or time stamps"
        raise InputError(wall.case.source, "sensors", got, remedy)
    paths = _paths(room, walls, points, normals, accuracy, groups)
    base = Deposit(walls, before.directions, suns.diameter, subdivision, accuracy, None)
    material = elements % len(palette.names)
    straight_elements = elements[palette.straight[material]]
    scattering_elements = elements[palette.scattering[material]]
    shape = (groups, len(labels), len(points))
    basis = Basis(
        tiles=tiles,
        palette=palette,
        points=points,
        labels=labels,
        suns=suns.labels,
        elements=elements,
        straight_elements=straight_elements,
        scattering_elements=scattering_elements,
        total=np.empty((len(elements), *shape), np.float32),
        straight=np.empty((len(straight_elements), *shape), np.float32),
        scattered=np.empty((len(scattering_elements), *shape), np.float32) if groups > 1 else None,
        grouped=np.empty((len(elements), *shape[:2], paths.blocks), np.float32),
        returned=Returned(*paths.marked()),
    )
    for group in range(groups):
        matrix = paths.matrix(group)
        deposits = _elements(room, base, paths, group, points, normals)
        for done, (element, on_sensors, on_cells) in enumerate(deposits, 1):
            _fill(basis, group, element, paths, matrix, on_sensors, on_cells)
            progress((group + done / len(elements)) / groups)
    return basis


def memory(
    wall: Wall, tiles: Tiles, palette: Palette, suns: Suns, accuracy: Accuracy, *,
    groups: int | None = None, subdivision: int = 1,
) -> int:  # fmt: skip
    """Memory that a basis and its light paths take [bytes]; arguments as for `compute`."""
    groups = accuracy.replicates if groups is None else groups
    parts = 1 + palette.straight + (palette.scattering & (groups > 1))  # kept of each element
    kept = int(((palette.allowed & palette.lets_in) * parts).sum())
    bins = len(Patches(subdivision)) + int(_before_facade(tiles, suns).sum())
    of_paths = 5 * 12 * accuracy.replicates * accuracy.paths  # numbers kept per sensor
    sensors = len(sensor_points(wall.case)[0])
    return 4 * sensors * (groups * kept * bins + of_paths)


def _fill(
    basis: Basis, group: int, element: int, paths: MarkedPaths, matrix: csr_matrix | np.ndarray,
    on_sensors: list[Irradiance], on_cells: Irradiance,
) -> None:  # fmt: skip
    """Write C and the block means of D of an element in one group into a basis."""
    i = np.searchsorted(basis.elements, element)
    cells = on_cells.numpy()
    direct = on_sensors[0] if len(on_sensors) == 1 else on_sensors[0].plus(on_sensors[1])
    basis.total[i, group] = (direct.numpy() + matrix @ cells).T
    basis.grouped[i, group] = (paths.means @ cells).T
    if element in basis.straight_elements:
        at = np.searchsorted(basis.straight_elements, element)
        basis.straight[at, group] = on_sensors[0].numpy().T
    if basis.scattered is not None and element in basis.scattering_elements:
        at = np.searchsorted(basis.scattering_elements, element)
        basis.scattered[at, group] = on_sensors[-1].numpy().T


def _before_facade(tiles: Tiles, suns: Suns) -> np.ndarray:
    """Whether suns may shine on the façade from outside, shape (sun,)."""
    outward = -unit_normals(tiles.quads[:1])[0]
    return suns.directions @ outward > -np.sin(np.radians(suns.diameter) / 2)


def _room(wall: Wall, tiles: Tiles, palette: Palette) -> tuple[TiledRoom, scene.Scene]:
    """Room without its tiles: for the views of `views`, and as a scene."""
    case, room = wall.case, wall.case.room
    assert room is not None
    case.refuse_components("a façade basis")
    others = [side for side in case.glazed if side != wall.side]
    if others:
        remedy = "a basis holds one façade: make the others wall, or evaluate each case"
        raise InputError(case.source, "facade", f"windows in {others[0]} too", remedy)
    if scene.is_coloured(case):
        got = "a reflectance differs between channels"
        raise InputError(case.source, "room", got, "make it grey, or evaluate each case")
    bare = case.model_copy(update={"facade": {}})
    name = f"wall {wall.side}"
    parts = [s for s in surfaces_of(bare) if s.name != name]
    around = wall_around(wall, tiles)
    if len(around):
        parts.append(Surface(name, Lambertian(room.walls), around))
    corners = np.concatenate([s.quads.reshape(-1, 3) for s in parts] + [tiles.quads.reshape(-1, 3)])
    turn, size = rotation(case), np.array(room.size)
    inside = corners @ turn
    if ((inside < -1e-3) | (inside > size + 1e-3)).any():
        got = "stands outside of the room"
        remedy = "leave it out, or evaluate each case"
        raise InputError(case.source, "furniture", got, remedy)
    enclosure = Enclosure(size, turn, np.zeros((0, 4, 3)))
    walls = replace(scene.build(parts, 0, enclosure), corners=corners)
    return TiledRoom(tuple(walls.full.shapes()), corners, enclosure, tiles, palette), walls


def _paths(
    room: TiledRoom, walls: scene.Scene, points: np.ndarray, normals: np.ndarray,
    accuracy: Accuracy, groups: int,
) -> MarkedPaths:  # fmt: skip
    """Trace the paths of all sensors."""
    meetings = Meetings(room.tiles, room.palette)
    world = walls.searched(full=room.scene(meetings.mesh))
    gathered = Gathered.of(
        world, points, normals, accuracy, block=len(points), lanes=PATHS, marks=meetings
    )
    return MarkedPaths(gathered, len(points), accuracy.replicates // groups)


def _elements(
    room: TiledRoom, base: Deposit, paths: MarkedPaths, group: int, points: np.ndarray,
    normals: np.ndarray,
) -> Iterator[tuple[int, list[Irradiance], Irradiance]]:  # fmt: skip
    """Element, its deposit in one group on sensors (straight part first), and on cells."""
    draws = range(group * paths.draws, (group + 1) * paths.draws)
    palette, a, p, n = room.palette, base.accuracy, flat(points), flat(normals)
    drawn = paths.gathered.drawn.apart()
    on_cells = [(drawn[d].p, drawn[d].n) for d in draws]
    both = (
        Receivers(1, [(p, n)] * len(draws), a.sensor_sky_rays, a.sensor_sun_samples),
        Receivers(0, on_cells, a.cell_sky_rays, 1),
    )
    for m in range(len(palette.kinds)):
        if not (palette.lets_in[m] and palette.allowed[:, m].any()):
            continue
        sources = []
        if palette.straight[m]:
            sources.append(straight(room, m, base, draws, both))
        if palette.scattering[m]:
            sources.append(scattered(room, m, base, draws, both))
        for tile in map(int, np.flatnonzero(palette.allowed[:, m])):
            sensors, cells = zip(*(source(tile) for source in sources), strict=True)
            on = cells[0] if len(cells) == 1 else cells[0].plus(cells[1])
            yield tile * len(palette.names) + m, list(sensors), on
