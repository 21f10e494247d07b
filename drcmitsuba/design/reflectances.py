r"""Reflectances of a room's surfaces as design parameters, with gradients.

The façade is fixed, and so is D, what reaches sensors and cells before any diffuse reflection. Only
the gather depends on the reflectances ρ:

.. math:: E(\rho) = D_s L + G(\rho) \, (D_c L), \qquad
          G(\rho) = \sum_v w_v \prod_k (\rho_k / \rho'_k)^{n_{vk}},

with the vertices v of paths that were traced once, at ρ′, and n the number of times that a path
met surface k up to and with the vertex. D·L is multiplied out beforehand; what is left is a
polynomial in ρ, made of one product of matrices, and Dr.Jit differentiates it exactly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.toml import choose, shortened
from drcmitsuba.design.annual_illuminance import Year
from drcmitsuba.design.bounce_counts import FRAMES, WALLS, Sums, marked, numbered, powers
from drcmitsuba.design.parameters import Parameter
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, Stage, silent
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene import scene
from drcmitsuba.scene.materials import channel_of
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.surfaces import State
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport.cells import Cells, Grid, draw_points
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.facade_basis.year import Illuminances
from drcmitsuba.transport.films import Films
from drcmitsuba.transport.gather import gather
from drcmitsuba.transport.panes import PanePatches

BOUNDS = (0.0, 0.95)
"""Reflectances that a design may take."""
DARKEST = 0.85
"""Paths are traced at this reflectance ρ′ or a higher one: darker surfaces only need lower weights.
Weights grow by ρ/ρ′ with every hit, so their second moment by ρ²/ρ′ times what does not leave by
the windows: at ρ = 0.95 it has a limit from here on, and had none with 0.7."""
MOST_KEYS = 8
_ROOM = ("floor", "ceiling", "walls")
_TAKEN = {*_ROOM, *WALLS, *FRAMES}


def reflectances(case: Case) -> dict[str, float]:
    """Reflectances of a case by key: floor, ceiling, walls, and furniture by its name.

    Raises
    ------
    InputError
        The case is coloured, has more than `MOST_KEYS` of them, or gives a name to two.
    """
    if scene.is_coloured(case):
        got = "a reflectance differs between channels"
        raise InputError(case.source, "room", got, "make it grey")
    room = case.room
    found = {} if room is None else {k: channel_of(getattr(room, k), 0) for k in _ROOM}
    for piece in case.furniture:
        value = channel_of(piece.reflectance, 0)
        if piece.name in _TAKEN or found.setdefault(piece.name, value) != value:
            got = f"{shortened(piece.name)} names surfaces of two reflectances"
            raise InputError(case.source, "furniture.name", got, "give each its own name")
    if len(found) > MOST_KEYS:
        got = f"{len(found)} kinds of surfaces"
        remedy = f"at most {MOST_KEYS}: give pieces of one reflectance one name"
        raise InputError(case.source, "furniture.name", got, remedy)
    return found


def with_reflectances(case: Case, rho: Mapping[str, float]) -> Case:
    """Case with other reflectances of some of its surfaces.

    Raises
    ------
    InputError
        A key is unknown, or a value is not in 0 … 1.
    """
    _check(case.source, reflectances(case), rho)
    values = {k: float(v) for k, v in rho.items()}
    update: dict[str, object] = {
        "furniture": tuple(
            piece.model_copy(update={"reflectance": values.get(piece.name, piece.reflectance)})
            for piece in case.furniture
        )
    }
    if case.room is not None:
        of_room = {k: v for k, v in values.items() if k in _ROOM}
        update["room"] = case.room.model_copy(update=of_room)
    return case.model_copy(update=update)


def _check(source: str, known: Mapping[str, float], rho: Mapping[str, float | mi.Float]) -> None:
    """Refuse unknown keys and values that are no reflectance."""
    for key, value in rho.items():
        if key not in known:
            got = f"no surface {shortened(key)}"
            raise InputError(source, "reflectance", got, choose(key, list(known)))
        number = np.ravel(dr.detach(value))
        if number.size != 1 or not 0 <= number[0] <= 1:
            got = f"{shortened(number.tolist())} for {shortened(key)}"
            raise InputError(source, "reflectance", got, "give one number from 0 to 1")


@dataclass(frozen=True)
class _State:
    """A room in one state of its shade.

    Parameters
    ----------
    before : mi.TensorXf, shape (time, sensor)
        Illuminance before any diffuse reflection [lx].
    direct : mi.TensorXf, shape (time, sensor)
        By the sun, straight [lx].
    cells : mi.TensorXf, shape (time, cell)
        D·L [lx].
    gathered : Sums
        Place: cell · sensors + sensor.
    means_before : np.ndarray, shape (replicate, sensor)
        Mean of `before` over time, in each replicate [lx].
    means : Sums
        Likewise of the interreflected light; place: replicate · sensors + sensor.
    digits : list of list of mi.Bool
        Binary digits of how often paths of each mark met each of the surfaces.
    """

    before: mi.TensorXf
    direct: mi.TensorXf
    cells: mi.TensorXf
    gathered: Sums
    means_before: np.ndarray
    means: Sums
    digits: list[list[mi.Bool]]

    @classmethod
    def of(cls, case: Case, state: State, light: Daylight, progress: Progress) -> _State:
        """Trace paths, find the deposit, and multiply it by the light."""
        a, suns, year = case.accuracy, light.suns, Year.of(light)
        world, marks = marked(case, state, reflectances(case))
        points, normals = sensor_points(case)
        grid = Grid.of(world, a.cell_size)
        vertices = gather(
            world, points, normals, replicates=a.replicates, paths=a.paths,
            grid=grid, seed=launch_seed(a.seed, Stream.PATHS), marks=marks,
        )  # fmt: skip
        known = Cells.none(grid).extended(vertices)
        if not known.count:
            raise InputError(case.source, "sensors", "no surface in their sight", "add a [room]")
        cell = known.of(vertices)
        panes, size = [panes.quads for panes in world.scattering], 2 * a.cell_size
        patches = PanePatches.of(panes, size) if panes else None
        films = Films.of(world, size, suns.directions, suns.diameter)
        bins = (suns.directions, suns.diameter, case.sky.subdivision)
        base = Deposit(world, *bins, a, patches, films)
        p, n = (mi.Float(x.astype(np.float32).ravel()) for x in (points, normals))
        parts, means_before, means_of_cells = [], [], []
        samples = a.sensor_sun_samples if suns.straight else 0
        for r in range(a.replicates):
            deposit = base.lit(r)
            straight = deposit.straight(p, n, (Stream.SENSORS, r), a.sensor_sky_rays, samples)
            before = year.by_all(straight.plus(deposit.scattered(p, n, (Stream.SENSORS, r))))
            _, q, facing = draw_points(vertices, cell, known.count, r)
            on_cells = deposit.straight(q, facing, (Stream.CELLS, r), a.cell_sky_rays)
            cells = year.by_all(on_cells.plus(deposit.scattered(q, facing, (Stream.CELLS, r))))
            parts.append((before, year.by_sun(straight), cells))
            parts = [tuple(sum(x[1:], x[0]) for x in zip(*parts, strict=True))]
            dr.eval(parts)
            means_before.append(dr.mean(before, axis=0).numpy())
            means_of_cells.append(dr.mean(cells, axis=0).numpy())
            progress((r + 1) / a.replicates)
        before, direct, cells = (x / a.replicates for x in parts[0])
        dr.eval(before, direct, cells)
        assert vertices.mark is not None
        kinds, mark = numbered(vertices.mark)
        row, weight, count = vertices.row, vertices.weight, dr.opaque(mi.UInt32, len(points))
        at = row // count * dr.opaque(mi.UInt32, known.count) + cell
        mean_there = dr.gather(mi.Float, mi.Float(np.concatenate(means_of_cells)), at)
        size, rows = known.count * len(points), a.replicates * len(points)
        return cls(
            before, direct, cells,
            Sums.of(cell * count + row % count, mark, weight / a.replicates, size),
            np.stack(means_before),
            Sums.of(row, mark, weight * mean_there, rows),
            marks.digits(kinds),
        )  # fmt: skip

    def interreflected(self, ratios: list[mi.Float]) -> mi.TensorXf:
        """G·D·L (time, sensor) [lx], for ratios of the reflectances to those that were traced."""
        cells, sensors = self.cells.shape[1], self.before.shape[1]
        g = self.gathered.weighed(powers(ratios, self.digits))
        return self.cells @ mi.TensorXf(g, (cells, sensors))

    def spread(self, ratios: list[mi.Float]) -> np.ndarray:
        """Standard error of the mean over time, (sensor,) [lx]."""
        inner = self.means.weighed(powers(ratios, self.digits)).numpy()
        total = self.means_before + inner.reshape(self.means_before.shape)
        return total.std(axis=0, ddof=1) / np.sqrt(len(total))


@dataclass(frozen=True)
class Interior:
    """Illuminance of a year as a function of the reflectances in a room.

    Parameters
    ----------
    start : dict of str to float
        Reflectances of the case by key: `floor`, `ceiling`, `walls`, furniture by its name.
    traced : dict of str to float
        Those that paths were traced at.
    months : np.ndarray of int, shape (time,)
    step_hours : float
        What one time stamp stands for [h].

    Notes
    -----
    Frames of façades, panes and shades keep the reflectances that they have. Paths are traced at
    `DARKEST` or more, so that weights stay even towards black. Above the traced reflectances they
    grow with every hit, and so does the noise: `standard_error` tells; where it is too large, take
    ``Interior.of(with_reflectances(case, rho), light)``. In the paper's classroom it is 1.0 % of E
    at the start, at most 1.6 % with any one surface at 0.95, and 7 % with all of them. Sensors
    are traced all at once, 1 MB each with 8 replicates of 128 paths.
    """

    start: dict[str, float]
    traced: dict[str, float]
    months: np.ndarray
    step_hours: float
    source: str
    states: tuple[_State, ...]

    @classmethod
    def of(cls, case: Case, light: Daylight, stage: Stage = silent) -> Interior:
        """Trace a case and its year, once.

        An adaptive sun is simulated as the exact sun of each time stamp.

        Raises
        ------
        InputError
            The case is coloured, has no surfaces or too many, or its names tell them not apart.
        """
        case.refuse_components("the search for reflectances")
        start = reflectances(case)
        if not start:
            raise InputError(case.source, "room", "there is no surface", "add a [room]")
        traced = {key: max(value, DARKEST) for key, value in start.items()}
        at = with_reflectances(case, traced)
        states: list[_State] = []
        names: list[State] = ["open"] if case.shading is None else ["open", "shaded"]
        for name in names:
            with stage(f"{name} façade") as done:
                states.append(_State.of(at, name, light, done))
        months = light.sky["clock"].dt.month.values
        return cls(start, traced, months, light.step_hours, case.source, tuple(states))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What a design may turn."""
        low, high = BOUNDS
        return tuple(Parameter(k, low, max(high, v), v) for k, v in self.start.items())

    def _ratios(self, rho: Mapping[str, mi.Float | float]) -> list[mi.Float]:
        _check(self.source, self.start, rho)
        return [
            mi.Float(rho[key] if key in rho else dr.opaque(mi.Float, self.start[key])) / value
            for key, value in self.traced.items()
        ]

    def illuminance(self, rho: Mapping[str, mi.Float | float]) -> Illuminances:
        """E at some reflectances; gradients flow through.

        Parameters
        ----------
        rho : dict of str to mi.Float
            Reflectances by key; those that are missing stay at the case's.

        Returns
        -------
        Illuminances
            Without a shade, `shaded` is `open`.

        Raises
        ------
        InputError
            A key is unknown, or a value is not in 0 … 1.
        """
        ratios = self._ratios(rho)
        found = [state.before + state.interreflected(ratios) for state in self.states]
        return Illuminances(found[0], found[-1], self.states[0].direct)

    def standard_error(self, rho: Mapping[str, mi.Float | float]) -> np.ndarray:
        """Standard error of the mean over time, shade open, (sensor,) [lx].

        From the scatter of the replicates, each with its own paths and deposit. Where a few paths
        carry most of the light, some ten times the traced weights, it is itself unsure.
        """
        return self.states[0].spread(self._ratios({k: dr.detach(v) for k, v in rho.items()}))
