"""A case as a scene of Radiance, with sensors, sources, luminances and the script of its run."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.sparse import csr_matrix

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, SHADED, State
from drcmitsuba.case.sun import Adaptive, TrueSun
from drcmitsuba.export.mtx import write_mtx
from drcmitsuba.export.primitives import GLAZING, GLAZING_FILE, identifier
from drcmitsuba.export.scene_files import scene_files
from drcmitsuba.export.script import Simulation, script
from drcmitsuba.export.sources import SKY, SUN_RADIANCE, sun_modifiers, sun_text
from drcmitsuba.metrics.bin_luminances import source_luminances
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.geometry import clockwise, origin
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.sky.daylight import Daylight, daylight


def save_radiance(case: Case, folder: str | Path, state: State = OPEN) -> Simulation:
    """Write a case in one state of its façade to a new folder, for Radiance to simulate.

    Parameters
    ----------
    case : Case
        An adaptive sun becomes the true one: Radiance traces every sun.
    folder : str or Path
        New or empty folder.
    state : str
        State of the façade, see `case.groups`.

    Returns
    -------
    Simulation
        What the script says of the case.

    Raises
    ------
    InputError
        The case is unfit, there is no shade to close, or the folder holds files.

    Examples
    --------
    >>> import drcmitsuba
    >>> from pathlib import Path
    >>> from drcmitsuba.export.radiance import save_radiance
    >>> simulation = save_radiance(drcmitsuba.load_case("office.toml"), Path("radiance"))
    >>> simulation.sensors
    16
    """
    if state == SHADED and not len(prepared(case).groups):
        got = "shaded, but the case has no shade"
        raise InputError(case.source, "shading", got, "add a table [shading], or leave it open")
    if isinstance(case.sun, Adaptive):
        case = case.with_tables(sun=TrueSun())
    points, normals = prepared(case).receivers.at()
    light = daylight(case)
    scene = scene_files(surfaces_of(case, state), clockwise(case))
    L_sky, L_suns = _luminances(light)
    simulation = Simulation(
        title=identifier(case.name),
        state="/".join(map(identifier, state.split("/"))),
        sensors=len(points),
        times=light.sky.sizes["time"],
        suns=len(light.suns.labels),
        subdivision=case.sky.subdivision,
        has_films=bool(scene.films),
        remarks=(*scene.differences, *_remarks(case)),
        notes=light.notes,
    )
    vectors = np.concatenate([points, normals], axis=1)
    times = np.datetime_as_string(light.sky["time"].values, unit="m")
    texts = {
        "materials.rad": scene.materials,
        "scene.rad": scene.polygons,
        "sky.rad": SKY,
        GLAZING_FILE: GLAZING,
        "sensors.pts": "".join(" ".join(f"{v:.9g}" for v in row) + "\n" for row in vectors),
        "times.txt": "".join(f"{time}\n" for time in times),
        "simulate.sh": script(simulation),
    }
    if simulation.suns:
        texts["suns.rad"] = sun_text(light.suns)
        texts["suns.txt"] = "".join(f"{name}\n" for name in sun_modifiers(light.suns))
    with storage.new_folder(folder) as files:
        for name, text in texts.items():
            (files / name).write_text(text, encoding="ascii", newline="\n")
        for path, name in scene.films.items():
            shutil.copyfile(path, files / name)
        write_mtx(files / "L_sky.mtx", L_sky)
        if simulation.suns:
            write_mtx(files / "L_suns.mtx", L_suns / SUN_RADIANCE)
    return simulation


def _luminances(light: Daylight) -> tuple[csr_matrix, csr_matrix]:
    """Luminances [cd/m²] of sky and ground, and of the suns, shape (bin, time) each."""
    patches = len(light.sky["bin"])
    labels = np.array([*light.sky["bin"].values, *light.suns.labels], dtype=object)
    L = source_luminances(xr.Dataset(coords={"bin": labels}), light.sky).T.tocsr()
    return L[:patches], L[patches:]


def _remarks(case: Case) -> list[str]:
    """Parts of a case that the script ignores."""
    remarks = case.colour.notes_without_bands
    if case.effects.overruled:
        remarks.append("Radiance simulates all effects of light, whatever the table [effects] says")
    start, turned = origin(case), clockwise(case)
    if turned:
        remarks.append(f"the scene is turned clockwise by {turned:g} degrees: its y axis is north")
    if start.any():
        place = " ".join(f"{v:.10g}" for v in start)
        remarks.append(f"the scene's origin lies at {place} of the case [m]")
    return remarks
