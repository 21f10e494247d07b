"""From a case and its light to coefficients and illuminance: where weather and transport meet."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from pathlib import Path

import numpy as np
import xarray as xr

from drcmitsuba import schema
from drcmitsuba.annual.sample_accumulator import SampleAccumulator, by_state
from drcmitsuba.case.case import Case
from drcmitsuba.case.components import MeshComponent, StructureComponent
from drcmitsuba.case.materials import BsdfMaterial
from drcmitsuba.case.sun import Adaptive
from drcmitsuba.metrics import illuminance
from drcmitsuba.metrics.evaluate_metrics import may_close
from drcmitsuba.plan import plan
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, Stage, part, silent, timed
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS, EnabledEffects
from drcmitsuba.scene.geometry import origin
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.structures.recipe import Mesh, load_recipe
from drcmitsuba.scene.surfaces import State
from drcmitsuba.schema import LUMINANCE_WEIGHTS
from drcmitsuba.sky.daylight import Daylight, sources
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.sun_interpolation import mesh_of, meshed, with_straight


def transport(
    case: Case, state: State, suns: Suns, latitude: float, *,
    scope: EnabledEffects = ALL_EFFECTS, mesh: tuple[str, ...] = (),
    sensors: np.ndarray | None = None, progress: Progress = lambda share: None,
    rays: Counter[str] | None = None,
) -> xr.Dataset:  # fmt: skip
    """Coefficients of a case in one state of its shade, `channel` added where it is coloured.

    Parameters
    ----------
    case : Case
    state : {"open", "shaded"}
    suns : Suns
    latitude : float
        [deg north]; matters to an adaptive sun only.
    scope : EnabledEffects
        What is simulated.
    mesh : tuple of str
        Suns of its mesh, where they are known.
    sensors : np.ndarray of int, optional
        Those of the case that are wanted.
    progress : callable
    rays : Counter, optional
        Takes the number of rays by kind.
    """
    points, normals = sensor_points(case)
    start = origin(case)
    if sensors is not None:
        points, normals = points[sensors], normals[sensors]
    coloured = scene.is_coloured(case) if scope.channels is None else scope.channels
    channels = list(LUMINANCE_WEIGHTS) if coloured else [""]
    subdivision = case.sky.subdivision
    found: list[xr.Dataset] = []
    for i in range(len(channels)):
        done = part(progress, i / len(channels), (i + 1) / len(channels))
        world = scene.load(case, state, i if coloured else -1, scope)
        if isinstance(case.sun, Adaptive):
            known = mesh or (mesh_of(found[0]) if found else ())
            of_channel = meshed(
                world, points, normals, suns.diameter, case.accuracy, latitude=latitude,
                tolerance=case.sun.tolerance, finest=case.sun.finest, subdivision=subdivision,
                known=known, progress=done,
            )  # fmt: skip
            of_channel = with_straight(of_channel, world, points, normals, suns, case.accuracy)
        else:
            of_channel = compute(
                world, points, normals, suns, case.accuracy, subdivision=subdivision, progress=done
            )
        at = {axis: ("sensor", points[:, i] + start[i]) for i, axis in enumerate("xyz")}
        found.append(of_channel.assign_coords(at))
        if rays is not None:
            rays.update(world.ray_counter.counted())
    if len(channels) == 1:
        return found[0]
    return xr.concat(found, xr.DataArray(np.array(channels, dtype=object), dims="channel"))


def states(found: dict[str, xr.Dataset], case: Case) -> xr.Dataset:
    """Join the states along `state`; suns that were not computed in the shaded state are NaN."""
    is_open = found["open"]
    names = xr.DataArray(np.array(list(found), dtype=object), dims="state", name="state")
    labels = {name: is_open[name] for name in ("bin", "sun") if name in is_open.coords}
    whole = [data.reindex(labels) for data in found.values()]
    joined = xr.concat(whole, names, coords="minimal", compat="override", join="exact")
    joined.attrs = {**is_open.attrs, "case": case.name, "has_shade": int(case.shading is not None)}
    if case.shading is not None:
        joined.attrs |= {
            "shade_threshold": case.shading.threshold,
            "shade_area": case.shading.area,
        }
    return schema.describe(joined)


def fingerprint(case: Case, scope: EnabledEffects) -> str:
    """Digest of all that coefficients follow from, the contents of files among it."""
    names = {"room", "facade", "materials", "components", "furniture", "sensors", "shading", "sun"}
    told = case.model_dump(mode="json", include=names | {"accuracy"})
    for name in ("target", "time_limit"):
        del told["accuracy"][name]
    chosen = {k: v for k, v in case.effects.overruled.items() if k != "dark_hours"}
    told |= {
        "effects": chosen,
        "scope": scope.to_dict(),
        "subdivision": case.sky.subdivision,
        "diameter": case.outside.sun_diameter,
    }
    for name, material in case.materials.items():
        if isinstance(material, BsdfMaterial):
            told["materials"][name]["file"] = _digest(material.file)
    for name, component in case.components.items():
        if isinstance(component, StructureComponent):
            recipe = load_recipe(component.recipe)
            told["components"][name]["recipe"] = recipe.model_dump(mode="json")
            if isinstance(recipe.structure, Mesh):
                told["components"][name]["mesh"] = _digest(recipe.path(recipe.structure.file))
        elif isinstance(component, MeshComponent):
            told["components"][name]["file"] = _digest(component.file)
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def coefficients(
    case: Case, light: Daylight, stage: Stage = silent, seconds: dict[str, float] | None = None,
    known: xr.Dataset | None = None, scope: EnabledEffects | None = None,
    rays: Counter[str] | None = None,
) -> xr.Dataset:  # fmt: skip
    """C of both states; the shaded one only for the suns of hours in which the shade may close.

    Parameters
    ----------
    case : Case
    light : Daylight
    stage : callable, optional
    seconds : dict, optional
        Takes the seconds of the stages.
    known : xr.Dataset, optional
        Coefficients of this case for another weather: what they hold is not computed again.
    scope : EnabledEffects, optional
        What is simulated; by default what the case calls for.
    rays : Counter, optional
        Takes the number of rays by kind.

    Returns
    -------
    xr.Dataset
        Dims state, sensor, bin, replicate.

    Raises
    ------
    InputError
        The known coefficients are those of another case.
    """
    seconds = {} if seconds is None else seconds
    scope = plan(case, light).scope if scope is None else scope
    simulated = case if scope.shade else case.without_shading()
    latitude = light.sky.attrs["latitude"]
    found: dict[str, xr.Dataset] = {} if known is None else _known(known, case, light, scope)

    def state(name: State, suns: Suns, done: Progress) -> xr.Dataset:
        return _state(simulated, name, suns, latitude, found, scope, done, rays)

    with timed(stage, "open façade", seconds) as done:
        found["open"] = state("open", light.suns, done)
    if simulated.shading is not None:
        closing = may_close(case, light, found["open"]) | scope.every_shade
        if closing.any():
            needed = light.suns.only(sources(light.sky.isel(time=closing)))
            with timed(stage, "shaded façade", seconds) as done:
                found["shaded"] = state("shaded", needed, done)
    joined = states(found, simulated)
    joined.attrs |= {name: light.sky.attrs[name] for name in illuminance.SUN_OF}
    joined.attrs["fingerprint"] = fingerprint(case, scope)
    return joined


def _known(
    known: xr.Dataset, case: Case, light: Daylight, scope: EnabledEffects
) -> dict[str, xr.Dataset]:
    """States of coefficients that were computed before, checked."""
    if known.attrs.get("fingerprint") != fingerprint(case, scope):
        raise InputError(
            "coefficients", "case", "they were computed for another case or accuracy",
            "compute them anew",
        )  # fmt: skip
    illuminance.check_suns(
        known, light.sky, illuminance.SUN_OF if case.sun.model != "adaptive" else ("latitude",)
    )
    return {state: pool.found for state, pool in by_state(known).items()}


def _state(
    case: Case, state: State, suns: Suns, latitude: float, known: dict[str, xr.Dataset],
    scope: EnabledEffects, progress: Progress, rays: Counter[str] | None,
) -> xr.Dataset:  # fmt: skip
    """Coefficients of one state, taken from what is known as far as that goes."""
    if state not in known:
        mesh = mesh_of(known["open"]) if "open" in known else ()
        return transport(
            case, state, suns, latitude, scope=scope, mesh=mesh, progress=progress, rays=rays
        )
    if not isinstance(case.sun, Adaptive):
        pool = SampleAccumulator(known[state])
        missing = suns.only(pool.missing(suns.labels, "bin"))
        if missing.labels:
            more = transport(
                case, state, missing, latitude, scope=scope, progress=progress, rays=rays
            )
            pool.extend(more)
        return pool.found
    points, normals = sensor_points(case)
    channels = known[state].sizes.get("channel", 0)
    found = []
    for i in range(max(1, channels)):
        world = scene.load(case, state, i if channels else -1, scope)
        of_channel = known[state].isel(channel=i) if channels else known[state]
        found.append(with_straight(of_channel, world, points, normals, suns, case.accuracy))
        if rays is not None:
            rays.update(world.ray_counter.counted())
    return xr.concat(found, known[state]["channel"]) if channels else found[0]
