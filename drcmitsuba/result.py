"""One evaluation from case to numbers: the only place where weather and transport meet."""

from __future__ import annotations

import re
import resource
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba import accumulate, backend, metrics, scene, schema
from drcmitsuba.case import Case
from drcmitsuba.coefficients import Suns, compute
from drcmitsuba.errors import InputError
from drcmitsuba.light import Daylight, daylight, luminances
from drcmitsuba.plan import notes, plan
from drcmitsuba.progress import Progress
from drcmitsuba.schema import LUMINANCE_WEIGHTS

Stage = Callable[[str], AbstractContextManager[Progress]]
"""Opens a named stage of the work; what it yields is told the share that is done."""


@contextmanager
def silent(name: str) -> Iterator[Progress]:
    """Show nothing of a stage."""
    yield lambda share: None


@dataclass(frozen=True)
class Result:
    """What an evaluation found; shows itself in Jupyter.

    Parameters
    ----------
    case : Case
    metrics : dict
        As in `metrics.json`.
    illuminance, coefficients, sky : xr.Dataset
        E, C and L as on disk.
    plan : dict
    """

    case: Case
    metrics: dict[str, Any]
    illuminance: xr.Dataset
    coefficients: xr.Dataset
    sky: xr.Dataset
    plan: dict[str, Any]

    def save(self, folder: str | Path, stage: Stage = silent) -> None:
        """Write all results and plots to a folder, each file whole or not at all."""
        from drcmitsuba import plots, report  # matplotlib is only loaded where plots are drawn

        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        start = time.perf_counter()
        with stage("writing") as done:
            schema.save_netcdf(self.illuminance, folder / "illuminance.nc")
            done(0.2)
            schema.save_zarr(self.coefficients, folder / "coefficients.zarr")
            done(0.5)
            schema.save_zarr(self.sky, folder / "sky.zarr")
            schema.save_json(self.plan, folder / "plan.json")
            done(0.6)
            figures = report.pictures(self.case, self.illuminance, self.metrics)
            for name, figure in figures.items():
                plots.save(figure, folder / name)
            self.metrics["seconds"]["writing"] = round(time.perf_counter() - start, 3)
            self.metrics["peak_memory_bytes"] = peak_memory()
            schema.save_json(self.metrics, folder / "metrics.json")

    def _repr_png_(self) -> bytes:
        from io import BytesIO

        from drcmitsuba import plots

        buffer = BytesIO()
        plots.monthly(self.metrics, title=self.case.name).savefig(buffer, format="png", dpi=100)
        return buffer.getvalue()


def peak_memory() -> int:
    """Largest memory that the process has held [bytes].

    On Linux, what getrusage tells counts also what the parent held when it started the process.
    """
    status = Path("/proc/self/status")
    if status.is_file():
        found = re.search(r"^VmHWM:\s*(\d+) kB$", status.read_text(), re.MULTILINE)
        if found is not None:
            return 1024 * int(found[1])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def transport(
    case: Case, state: scene.State, suns: Suns, progress: Progress = lambda share: None
) -> xr.Dataset:
    """Coefficients of a case in one state of its shade, `channel` added where it is coloured."""
    points, normals = scene.sensor_points(case)
    channels = list(LUMINANCE_WEIGHTS) if scene.is_coloured(case) else [""]

    def of_channel(i: int) -> xr.Dataset:
        return compute(
            scene.load(case, state, i), points, normals, suns, case.accuracy,
            subdivision=case.sky.subdivision,
            progress=lambda share: progress((i + share) / len(channels)),
        )  # fmt: skip

    found = [of_channel(i) for i in range(len(channels))]
    if len(channels) == 1:
        return found[0]
    return xr.concat(found, xr.DataArray(np.array(channels, dtype=object), dims="channel"))


def states(is_open: xr.Dataset, shaded: xr.Dataset | None, case: Case) -> xr.Dataset:
    """Join the states along `state`; suns that were not computed in the shaded state are NaN."""
    found = {"open": is_open} if shaded is None else {"open": is_open, "shaded": shaded}
    names = xr.DataArray(np.array(list(found), dtype=object), dims="state", name="state")
    whole = [data.reindex(bin=is_open["bin"]) for data in found.values()]
    joined = xr.concat(whole, names, coords="minimal", compat="override", join="exact")
    joined.attrs = {"case": case.name, "has_shade": int(case.shading is not None)}
    if case.shading is not None:
        joined.attrs |= {
            "shade_threshold": case.shading.threshold,
            "shade_area": case.shading.area,
        }
    return schema.describe(joined)


def closing(coefficients: xr.Dataset, light: xr.Dataset) -> xr.DataArray:
    """When the shade closes: bool by time, from the coefficients of the open state.

    The thresholds are attributes of the coefficients; without a shade it never closes.
    """
    direct = schema.luminance(by_channel(accumulate.direct_sun, coefficients, light)["direct_sun"])
    if not coefficients.attrs.get("has_shade", 0):
        return xr.zeros_like(direct.isel(sensor=0, drop=True), dtype=bool)
    attrs = coefficients.attrs
    return metrics.shade_closed(direct, attrs["shade_threshold"], attrs["shade_area"])


def by_channel(
    function: Callable[..., xr.Dataset], *arrays: xr.Dataset | xr.DataArray | None
) -> xr.Dataset:
    """Apply an accumulation to each colour channel of the coefficients, or once to grey ones."""
    first = arrays[0]
    assert first is not None
    if "channel" not in first.dims:
        return function(*arrays)
    found = [
        function(
            *(
                a.isel(channel=i, drop=True) if a is not None and "channel" in a.dims else a
                for a in arrays
            )
        )
        for i in range(first.sizes["channel"])
    ]
    return xr.concat(found, first["channel"], coords="minimal", compat="override")


SUN_OF = {"latitude": 0.5, "longitude": 0.5, "timezone": 0, "sun_diameter": 0, "sun_time": None}
"""What a sun's place follows from beside its label, and how far C and L may differ in it [deg]."""


def _check_suns(coefficients: xr.Dataset, light: xr.Dataset) -> None:
    """Refuse suns of another place: labels tell only their time."""
    for name, margin in SUN_OF.items():
        ours, theirs = coefficients.attrs.get(name), light.attrs.get(name)
        if ours is None or theirs is None or ours == theirs:
            continue  # arrays that the user made himself may not tell
        if not margin or abs(ours - theirs) > margin:
            got = f"{ours}, but {theirs} in the sky"
            raise InputError("coefficients", name, got, "compute coefficients for this weather")


def illuminance(coefficients: xr.Dataset, light: xr.Dataset) -> xr.Dataset:
    """E from C (dims state, …) and the sky, with the shade that the coefficients name.

    Raises
    ------
    InputError
        A bin has no coefficients, or the suns of C stand elsewhere than those of the sky.
    """
    _check_suns(coefficients, light)
    is_open = coefficients.sel(state="open", drop=True)
    closed = closing(is_open, light)
    shaded = None
    if "shaded" in coefficients["state"].values:
        shaded = coefficients.sel(state="shaded", drop=True)
    out = by_channel(accumulate.illuminance, is_open, shaded, light, closed)
    keep = ("has_shade", "shade_threshold", "shade_area")
    out.attrs = {k: v for k, v in coefficients.attrs.items() if k in keep}
    return out


def coefficients(
    case: Case, light: Daylight, stage: Stage = silent, seconds: dict[str, float] | None = None
) -> xr.Dataset:
    """C of both states; the shaded one only for the suns of hours in which the shade closes."""
    seconds = {} if seconds is None else seconds
    suns = Suns.of(light.sun, case.outside.sun_diameter)
    with timed(stage, "open façade", seconds) as done:
        is_open = transport(case, "open", suns, done)
    shaded = None
    if case.shading is not None:
        closed = closing(states(is_open, None, case).sel(state="open", drop=True), light.sky)
        if closed.any():
            needed = suns.only(light.sky["sun_bin"].values[closed.values])
            with timed(stage, "shaded façade", seconds) as done:
                shaded = transport(case, "shaded", needed, done)
    joined = states(is_open, shaded, case)
    joined.attrs |= {name: light.sky.attrs[name] for name in SUN_OF}
    return joined


@contextmanager
def timed(stage: Stage, name: str, seconds: dict[str, float]) -> Iterator[Progress]:
    """Show a stage and note its seconds."""
    start = time.perf_counter()
    with stage(name) as done:
        yield done
        done(1.0)
    seconds[name] = round(time.perf_counter() - start, 3)


def evaluate(case: Case, stage: Stage = silent) -> Result:
    """Evaluate a case: L, C, E and the metrics of its period.

    Parameters
    ----------
    case : Case
        From `load_case`.
    stage : callable, optional
        Shows the stages of the work, as the command line does.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        The weather, the period, a material or a sensor is unfit.
    BackendError
        No fit LLVM or GPU.
    """
    from drcmitsuba import report  # draws, so it brings matplotlib: not needed to import the rest

    variant = backend.select()
    seconds: dict[str, float] = {}
    with timed(stage, "sky", seconds):
        scene.sensor_points(case)  # what is wrong with the sensors is told before the work begins
        told = notes(case)  # reads the films' files, which may be unfit
        light = daylight(case)
    found = coefficients(case, light, stage, seconds)
    with timed(stage, "accumulation and metrics", seconds):
        E = illuminance(found, light.sky)
        E.attrs["step_hours"] = light.step_hours
        shading = case.shading
        numbers = report.summarise(
            E, case.metrics, step_hours=light.step_hours,
            shade_threshold=shading.threshold if shading else 1000.0,
            shade_area=shading.area if shading else 1.0,
        )  # fmt: skip
    closed = int(E["shade_closed"].sum())
    suns = int((light.sky["sun_bin"].values != "").sum())
    effects = plan(case, suns=suns, closed=closed, hours=E.sizes["time"])
    missing = [e["reason"] for e in effects.values() if e.get("missing")]
    numbers["settings"] = {
        "case": case.source,
        "variant": variant,
        "weather_source": light.source,
        "notes": [*light.notes, *told, *missing],
        **case.model_dump(mode="json", exclude_none=True),
    }
    numbers["seconds"] = seconds
    numbers["peak_memory_bytes"] = peak_memory()
    L = luminances(light)
    if "channel" in found.dims:
        L = L.expand_dims(channel=found["channel"])
    return Result(case, numbers, E, found, L, effects)
