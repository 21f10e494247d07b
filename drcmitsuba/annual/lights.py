"""Who lights a point: C and the year's light of sensors by window, source and bounces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.annual.light_tracing import LightTracing
from drcmitsuba.annual.result import Result
from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import load_case
from drcmitsuba.report.lights import of_period
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, part, silent
from drcmitsuba.scene.nearest_sensors import nearest_sensors
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.schema import describe


@dataclass(frozen=True, repr=False)
class Lights:
    """Light of chosen points by where it comes from; shows itself in Jupyter.

    Parameters
    ----------
    dataset : xr.Dataset
        `by_window` and `by_window_se`: C (state, window, bounces, sensor, bin) [sr]; their sum over
        windows and bounces is C. `exposure` (state, window, source, bounces, sensor) [lx h]: light
        of the time stamps at which the façade is in the state; `hours` (state,) [h]: how long that
        is. `direction` (bin, axis) and `solid_angle` (bin,) [sr] of the bins. The coordinate
        `sensor` is the number of the sensor.
    """

    dataset: xr.Dataset

    @property
    def shares(self) -> xr.DataArray:
        """Share in the light of a point (window, source, bounces, sensor) [–].

        The states count by their hours in an evaluation; without one only the first state counts.
        """
        light = of_period(self.dataset)
        return light / light.sum(["window", "source", "bounces"])

    def figure(self, sensor: int | None = None) -> Any:
        """Draw where the light of a sensor, by default the first one, comes from.

        Returns
        -------
        matplotlib.figure.Figure
            Light of the year by window, source and bounces; the sky as the point sees it by each
            window, straight and after bounces, with the suns of the year as dots.
        """
        from drcmitsuba.report.sky_dome import who_lights

        known = self.dataset["sensor"].values.tolist()
        sensor = known[0] if sensor is None else sensor
        if sensor not in known:
            got = f"no sensor {sensor}"
            raise InputError("lights", "sensor", got, f"choose one of {known}")
        return who_lights(self.dataset.sel(sensor=sensor))

    def save(self, folder: str | Path) -> list[Path]:
        """Write `lights.nc` and a picture of every point to a folder, and return their paths."""
        from drcmitsuba.report import plots

        folder = Path(folder)
        storage.save_netcdf(self.dataset, folder / "lights.nc")
        for old in folder.glob("lights_*.png"):
            old.unlink()
        sensors = self.dataset["sensor"].values.tolist()
        pictures = [plots.save(self.figure(s), folder / f"lights_{s}.png") for s in sensors]
        return [folder / "lights.nc", *pictures]

    def __repr__(self) -> str:
        sizes = self.dataset.sizes
        return (
            f"<Lights of {self.dataset.attrs['case']!r}: {sizes['sensor']} points, "
            f"{sizes['window']} windows, {sizes['state']} states, {sizes['bin']} bins>"
        )

    def _repr_html_(self) -> str:
        """Pictures of the first points."""
        from drcmitsuba.report import plots

        sensors = self.dataset["sensor"].values.tolist()[:3]
        images = [plots.html_image(self.figure(s), f"who lights sensor {s}") for s in sensors]
        return "".join(images)


def lights(
    case: Case | str | Path, points: Sequence[Sequence[float]], *,
    results: Result | str | Path | None = None, stage: Stage = silent,
) -> Lights:  # fmt: skip
    """Find out who lights points: by which window, from which source, after how many bounces.

    Parameters
    ----------
    case : Case, str or Path
        Case, TOML file, or name of a shipped case.
    points : sequence of (x, y) or (x, y, z)
        Points [m]; the sensor nearest to each is taken.
    results : Result, str or Path, optional
        Evaluation of this case, or its folder: the states of its façade count hour by hour. By
        default every state counts all the time.
    stage : callable, optional
        Function that shows the stages of the work.

    Returns
    -------
    Lights

    Raises
    ------
    InputError
        No point, one far from all sensors, too many points, or results of another case.

    Examples
    --------
    >>> import drcmitsuba
    >>> who = drcmitsuba.lights("office.toml", [(3.0, 1.0)])
    >>> who.shares.dims
    ('window', 'source', 'bounces', 'sensor')
    """
    case = case if isinstance(case, Case) else load_case(case)
    sensors = nearest_sensors(prepared(case).receivers.coordinates, points, case.source)
    if not sensors:
        raise InputError(case.source, "points", "none", "give x,y or x,y,z in metres")
    traced = LightTracing.of(case, results, stage)
    with traced.run.timed("who lights the points") as done:
        C = traced.coefficients(sensors, done)
    C["hours"] = ("state", traced.state_hours)
    C["exposure"] = traced.exposure(C["by_window"])
    suns, patches = traced.suns, Patches(case.sky.subdivision)
    C["direction"] = (("bin", "axis"), np.concatenate([patches.directions, suns.directions]))
    disks = np.full(len(suns.labels), disk_solid_angle(suns.diameter))
    C["solid_angle"] = ("bin", np.append(patches.solid_angles, disks))
    C.attrs = {**traced.attributes, "subdivision": case.sky.subdivision}
    return Lights(describe(C))


def lights_of_sensors(
    case: Case | str | Path, *,
    results: Result | str | Path | None = None, stage: Stage = silent,
) -> xr.Dataset:  # fmt: skip
    """Find out how much light every sensor of a case has from where, without its coefficients.

    Parameters
    ----------
    case, results, stage
        As for `lights`.

    Returns
    -------
    xr.Dataset
        `exposure` (state, window, source, bounces, sensor) [lx h] and `hours` (state,) [h], as in
        `Lights.dataset`; of the sensors that `lights` is asked for, with the same seed, it is the
        same but for the samples that are drawn.

    Raises
    ------
    InputError
        The results are of another case.

    Examples
    --------
    >>> import drcmitsuba
    >>> light = drcmitsuba.lights_of_sensors("office.toml")
    >>> light["exposure"].dims
    ('state', 'window', 'source', 'bounces', 'sensor')
    """
    case = case if isinstance(case, Case) else load_case(case)
    traced = LightTracing.of(case, results, stage)
    every = range(prepared(case).receivers.coordinates.sizes["sensor"])
    size = traced.block
    blocks = [every[first : first + size] for first in every[::size]]
    parts = []
    with traced.run.timed("who lights the sensors") as done:
        for i, sensors in enumerate(blocks):
            share = part(done, i / len(blocks), (i + 1) / len(blocks))
            parts.append(traced.exposure(traced.coefficients(sensors, share)["by_window"]))
    out = xr.concat(parts, "sensor", join="exact").to_dataset(name="exposure")
    out["hours"] = ("state", traced.state_hours)
    out.attrs = traced.attributes
    return describe(out)
