r"""Illuminance of a year as a function of the film on the façade.

Where all of a film sees the same sky, one matrix W[sensor, cell] maps the radiance that leaves it
in each outgoing cell to the sensors, interreflections included. W does not depend on the film, so
for any film with the answer A[cell, bin] (`design.film`)

.. math:: E_{t,s} = E^\text{rest}_{t,s} + \sum_o W_{s,o} \sum_b A_{o,b} L_{b,t}

with E^rest, all light that does not pass the film, fixed. W and E^rest come from one simulation in
which the film's cells are bins beside those of sky and suns, with the estimators and errors of
`transport.coefficients`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr
from drcmitsuba_plugins.lobes import square_code
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import State
from drcmitsuba.design.film import Film
from drcmitsuba.design.film_bins import FilmBins
from drcmitsuba.metrics import accumulate
from drcmitsuba.plan import plan
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.runtime.random_streams import Draw, Key
from drcmitsuba.runtime.toml import shortened
from drcmitsuba.scene import scene
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.schema import mean_and_error
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.daylight import daylight as daylight_of
from drcmitsuba.sky.luminances import luminances
from drcmitsuba.transport.coefficients import estimate
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.films.films import EvenRows, Films
from drcmitsuba.transport.films.looks import Looked
from drcmitsuba.transport.films.orientation import Mount
from drcmitsuba.transport.light.irradiance import Irradiance
from drcmitsuba.transport.panes.patches import PanePatches
from drcmitsuba.transport.panes.transfer import looks
from drcmitsuba.transport.rays.openings import Within

CELL = "film_{:04d}"
"""Labels of outgoing cells among the bins."""


@dataclass(frozen=True)
class CellDeposit(Deposit):
    """Deposit whose bins are sky patches, then a film's outgoing cells, then suns.

    The film's cells take the place of what passes it; `films` reflect light that reaches the film
    from the room, None where none does. `depth` is that of the outgoing cells.
    """

    film: PanePatches = field(kw_only=True)
    mount: Mount = field(kw_only=True)
    depth: int = field(kw_only=True)

    @property
    def bins(self) -> tuple[int, int]:
        """Number of sky bins with the film's cells, and of suns."""
        sky, suns = super().bins
        return sky + (1 << 2 * self.depth), suns

    def by_sky(
        self, p: mi.Float, n: mi.Float, key: Key, rays: int, numbers: mi.UInt32 | None,
        within: Within,
    ) -> mi.TensorXf:  # fmt: skip
        """D by straight light of ground and sky; none from the film's cells."""
        sky = super().by_sky(p, n, key, rays, numbers, within)
        none = dr.zeros(mi.TensorXf, (sky.shape[0], 1 << 2 * self.depth))
        return dr.concat((sky, none), axis=1)

    def by_films(
        self, p: mi.Float, n: mi.Float, key: Key, numbers: mi.UInt32 | None = None,
        within: Within = None,
    ) -> Irradiance | None:  # fmt: skip
        """D by what the film reflects, and irradiance per radiance of its cells [sr]."""
        if self.on_films is not None:
            return super().by_films(p, n, key, numbers, within)  # by way of `by_looked`
        cells = self._by_cells(p, n, key, numbers, within)
        sky, sun = (dr.zeros(mi.TensorXf, (cells.shape[0], bins)) for bins in super().bins)
        return Irradiance(dr.concat((sky, cells), axis=1), sun)

    def by_looked(
        self, looked: Looked, p: mi.Float, n: mi.Float, key: Key, numbers: mi.UInt32 | None,
        among: np.ndarray | None = None, without: tuple[EvenRows, ...] = (),
    ) -> Irradiance:  # fmt: skip
        """D by directions to a film that reflects, with its cells as `by_films`."""
        sky, sun = super().by_looked(looked, p, n, key, numbers, among, without)
        cells = self._by_cells(p, n, key, numbers, None)
        return Irradiance(dr.concat((sky, cells), axis=1), sun)

    def _by_cells(
        self, p: mi.Float, n: mi.Float, key: Key, numbers: mi.UInt32 | None, within: Within
    ) -> mi.TensorXf:
        """Projected solid angle [sr] of the film's cells for receivers, shape (receiver, cell)."""
        count, columns = dr.width(p) // 3, 1 << 2 * self.depth
        out = dr.zeros(mi.Float64, count * columns)
        for look in looks(
            self.scene, self.film, p, n,
            rays=self.accuracy.pane_points, seed=self.seed(key, Draw.FILMS),
            numbers=numbers, within=within,
        ):  # fmt: skip
            cell = square_code(self.mount.turn.to_local(-look.d).xy, self.depth)
            at = look.row * dr.opaque(mi.UInt32, columns) + cell
            D = mi.Float64(dr.pi * look.weight)
            dr.scatter_add(out, D, at, (look.weight > 0) & look.front)
            dr.eval(out)
        return mi.TensorXf(mi.Float(out), (count, columns))


def _refuse_components(case: Case) -> None:
    """Refuse components: what a film sends into them is not followed, and W would lack it."""
    if case.standing:
        got = f"the year of a film counts no light by way of {shortened(case.standing[0])}"
        raise InputError(case.source, "components", got, "leave them out, or use evaluate")


def _mount(case: Case, films: Films | None) -> Mount:
    """Orientation of a case's only film, which nothing shades and which has no view through."""
    mounts = films.mounts if films else ()
    if len(mounts) != 1:
        got = f"{len(mounts)} films or orientations of films"
        remedy = 'give strips of one material of type "bsdf" on one side'
        raise InputError(case.source, "facade", got, remedy)
    if len(mounts[0].sides) > 1:
        got, remedy = "a film that other things shade", "leave nothing behind its plane"
        raise InputError(case.source, "facade", got, remedy)
    if mounts[0].bsdf.has_view:
        got, remedy = "a film with a view straight through", 'set straight_through = "off"'
        raise InputError(case.source, "materials", got, remedy)
    return mounts[0]


@dataclass(frozen=True, eq=False)
class FilmYear:
    """Illuminances of a year behind any film.

    Parameters
    ----------
    transfer : mi.TensorXf, shape (sensor, cell)
        W, mean of the replicates [sr].
    transfers : np.ndarray, shape (replicate, sensor, cell)
        W of each independent replicate [sr].
    L : mi.TensorXf, shape (bin, time)
        Luminance of the bins [cd/m²].
    rest : mi.TensorXf, shape (time, sensor)
        E^rest, mean of the replicates [lx].
    rests : np.ndarray, shape (replicate, time, sensor)
        E^rest of each replicate [lx].
    coefficients : xr.Dataset
        C [sr] of all other light, as from `coefficients.compute`: dims sensor, bin, replicate.

    Notes
    -----
    Every film reflects light into the room as the case's film does. Other panes, the frame and all
    reflectances are fixed. The shade does not cover films; `state="shaded"` gives the year with the
    shade closed, or all groups of panes in their last state. Limits: one film in one orientation
    that nothing shades; grey rooms; no components; no light that one pane mirrors to another. True
    suns take the place of an adaptive one.
    """

    bins: FilmBins
    transfer: mi.TensorXf
    transfers: np.ndarray
    L: mi.TensorXf
    rest: mi.TensorXf
    rests: np.ndarray
    coefficients: xr.Dataset

    @classmethod
    def of(
        cls, case: Case, daylight: Daylight | None = None, *, state: State = "open",
        depth: int = 5, progress: Progress = lambda share: None,
    ) -> FilmYear:  # fmt: skip
        """Year of a case, simulated once for all films.

        Parameters
        ----------
        case : Case
            Case with strips of a film, of any file, on its façade; of this film only the reflection
            into the room has an effect.
        daylight : Daylight, optional
            Default: the daylight of the case.
        state : str
            State of the façade: "open", "shaded", or the states of all groups, see `case.groups`.
        depth : int
            2ᵈᵉᵖᵗʰ outgoing cells along each side of the square; a measured film of this depth or
            a lower one is represented exactly.
        progress : callable

        Returns
        -------
        FilmYear

        Raises
        ------
        InputError
            The case has no film or several, a film whose parts have different surroundings, or
            colours.
        """
        case.refuse_overruled("the year of a film")
        case = case.with_true_suns()
        _refuse_components(case)
        if scene.is_coloured(case):
            raise InputError(case.source, "materials", "colours", "take grey materials")
        daylight = daylight_of(case) if daylight is None else daylight
        if daylight.sky.attrs["sun_model"] == "adaptive":
            raise InputError("film year", "daylight", "that of an adaptive sun", "leave it out")
        planned, suns = plan(case, daylight).of_any_facade, daylight.suns
        # Photons from pane to pane would count what the film sends a second time.
        effects = replace(planned, pane_to_pane=False)
        world, subdivision = scene.load(case, state, effects=effects), case.sky.subdivision
        size = 2 * case.accuracy.cell_size
        films = Films.of(world, size, suns.directions, suns.diameter)
        mount = _mount(case, films)
        assert films is not None
        reflecting = None if mount.exposed else films.only_reflecting()
        panes = [panes.quads for panes in world.scattering]
        base = CellDeposit(
            world, suns.directions, suns.diameter, subdivision, case.accuracy,
            PanePatches.of(panes, size) if panes else None, reflecting,
            film=films.patches, mount=mount, depth=depth,
        )  # fmt: skip
        cells = [CELL.format(i) for i in range(1 << 2 * depth)]
        samples = case.accuracy.sensor_sun_samples if suns.straight else 0
        C = estimate(
            base, [*Patches(subdivision).labels, *cells, *suns.labels],
            *prepared(case).receivers.at(), sun_samples=samples, progress=progress,
        )  # fmt: skip
        is_cell = np.isin(C["bin"].values.astype(str), cells)
        transfers = C["replicates"].values[..., is_cell]
        rest = C.isel(bin=~is_cell)
        everyone = np.arange(rest.sizes["sensor"])
        rests = accumulate.replicates(rest, daylight.sky, everyone).astype(np.float32)
        L = luminances(daylight)["L"].values
        return cls(
            FilmBins(mount.frame, subdivision, suns, depth), _tensor(transfers.mean(axis=0)),
            transfers, _tensor(L.T), _tensor(rests.mean(axis=0)), rests, rest,
        )  # fmt: skip

    def radiance(self, film: Film) -> mi.TensorXf:
        """Luminance of a film in the direction of each cell at each time, (cell, time) [cd/m²]."""
        return film.answer(self.bins) @ self.L

    def illuminance(self, film: Film) -> mi.TensorXf:
        """Illuminance E (time, sensor) [lx], with the gradients of the film's parameters."""
        return self.rest + (self.transfer @ self.radiance(film)).T

    def leave_one_out(self) -> Iterator[FilmYear]:
        """Years without one replicate each, for the jackknife."""
        n = len(self.transfers)
        for r in range(n):
            kept = np.arange(n) != r
            transfer, rest = (_tensor(a[kept].mean(axis=0)) for a in (self.transfers, self.rests))
            yield replace(self, transfer=transfer, rest=rest)

    def replicates(self, film: Film) -> np.ndarray:
        """Illuminance E of every replicate, (replicate, time, sensor) [lx]."""
        leaving = dr.detach(self.radiance(film)).numpy()
        return self.rests + np.stack([(w @ leaving).T for w in self.transfers])

    def error(self, film: Film) -> np.ndarray:
        """Standard error of E, (time, sensor) [lx]."""
        return mean_and_error(self.replicates(film))[1]


def _tensor(values: np.ndarray) -> Any:
    return mi.TensorXf(np.ascontiguousarray(values, np.float32))
