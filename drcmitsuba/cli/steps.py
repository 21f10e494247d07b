"""Steps of an evaluation: `drcmitsuba sky`, `coefficients`, `illuminance`, `metrics`, `plot`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from drcmitsuba.cli.evaluate import metrics_tables
from drcmitsuba.cli.options import (
    CaseName,
    OptionalOutput,
    Output,
    Weather,
    argument,
    lengths,
    load,
    option,
)
from drcmitsuba.cli.terminal import show, show_notes, stages
from drcmitsuba.runtime.errors import InputError


def sky(case: CaseName, output: Output = Path("results"), weather: Weather = None) -> None:
    """Compute the luminances L of sky and suns: sky.zarr."""
    from drcmitsuba.sky.daylight import daylight
    from drcmitsuba.sky.luminances import save_luminances

    loaded = load(case, weather)
    with stages() as stage, stage("sky"):
        sources = daylight(loaded)
        save_luminances(sources, output / "sky.zarr")
    show_notes(sources.notes)
    print(f"{sources.sky.sizes['time']} time stamps are in {output / 'sky.zarr'}")


def coefficients(case: CaseName, output: Output = Path("results"), weather: Weather = None) -> None:
    """Compute the coefficients C of all states of the façade: coefficients.zarr.

    The coefficients hold every sun above the horizon, whether it shines in this weather or not.
    """
    from drcmitsuba.annual import simulation
    from drcmitsuba.annual.attributes import settings_text
    from drcmitsuba.annual.run import Run
    from drcmitsuba.plan import plan
    from drcmitsuba.runtime import backend, storage
    from drcmitsuba.sky import daylight

    given = load(case, weather)
    loaded = given.with_dark_hours()
    backend.select()
    with stages() as stage:
        with stage("sky"):
            sources = daylight.daylight_and_year(loaded)
        run = Run.of(loaded, plan(loaded, sources).scope)
        C = simulation.coefficients(loaded, sources, replace(run, stage=stage))
        # The next steps give results of the case as it was given.
        C = C.assign_attrs(settings=settings_text(given, sources))
        with stage("writing"):
            storage.save_zarr(C.parts(), output / "coefficients.zarr", along="state")
    show_notes(sources.notes)
    path, sizes = output / "coefficients.zarr", C.open.sizes
    print(f"{sizes['sensor']} sensors × {sizes['bin']} bins are in {path}")


def illuminance(
    c: Annotated[Path, argument("C", "coefficients.zarr")],
    l: Annotated[Path, argument("L", "sky.zarr")],  # noqa: E741
    output: Output = Path("results"),
) -> None:
    """Compute the illuminance E = C·L: illuminance.nc."""
    from drcmitsuba.metrics import stored_arrays
    from drcmitsuba.metrics.illuminance import illuminance as accumulated
    from drcmitsuba.runtime import storage

    with stages() as stage, stage("accumulation"):
        states, light = stored_arrays.coefficients_and_sky(c, l)
        E = accumulated(states, light)
        E.attrs["step_hours"] = light.attrs.get("step_hours", 1.0)
        storage.save_netcdf(E, output / "illuminance.nc")
    print(f"{E.sizes['time']} time stamps × {E.sizes['sensor']} sensors are in {output}")


def metrics(
    e: Annotated[Path, argument("E", "illuminance.nc")],
    output: OptionalOutput = None,
    sda_threshold: Annotated[float | None, option("NUMBER", "sDA: enough daylight [lx].")] = None,
    sda_fraction: Annotated[float | None, option("NUMBER", "sDA: fraction of the hours.")] = None,
    ase_threshold: Annotated[float | None, option("NUMBER", "ASE: too much sun [lx].")] = None,
    ase_hours: Annotated[float | None, option("NUMBER", "ASE: hours of too much sun [h].")] = None,
) -> None:
    """Compute sDA, ASE, msDA, MSE and shade hours of an illuminance file.

    Options replace the thresholds of the file's case.
    The intervals are mostly wider than those of evaluate: the file holds the error of every
    illuminance, but not the correlation of these errors.
    """
    from drcmitsuba.controls.space_lights import with_electric_light
    from drcmitsuba.metrics import evaluate_metrics, stored_arrays
    from drcmitsuba.metrics.space_years import SpaceYears
    from drcmitsuba.metrics.spaces import sensors_by_space
    from drcmitsuba.runtime import storage

    thresholds = {
        "sda_threshold": sda_threshold,
        "sda_fraction": sda_fraction,
        "ase_threshold": ase_threshold,
        "ase_hours": ase_hours,
    }
    E = stored_arrays.open_dataset(e, "total", "total_se", "direct_sun", "direct_sun_se")
    E = stored_arrays.loaded(e, E)
    rules = evaluate_metrics.rules_of(E.attrs, e, thresholds)
    spaces = sensors_by_space(E)
    years = SpaceYears.of_errors(E, spaces, rules)
    numbers = evaluate_metrics.summarise(E, rules, years=years)
    numbers = with_electric_light(numbers, years, spaces, E, rules.step_hours)
    if settings := evaluate_metrics.settings_of(E.attrs, e, rules.metrics):
        numbers["settings"] = settings
    if output is not None:
        numbers = _with_others(numbers, output / "metrics.json")
        storage.save_json(numbers, output / "metrics.json")
    show(*metrics_tables(numbers, str(e)))
    t = rules.metrics
    print(
        f"thresholds: sDA {t.sda_threshold:g} lx in {100 * t.sda_fraction:g} % of the hours, "
        f"ASE {t.ase_threshold:g} lx in {t.ase_hours:g} h"
    )


def _with_others(numbers: dict[str, Any], file: Path) -> dict[str, Any]:
    """Keep what an evaluation of the same case tells beside its thresholds, such as its notes."""
    from drcmitsuba.report.metrics_file import MAX_BYTES
    from drcmitsuba.runtime import storage

    if not file.exists():
        return numbers
    old = storage.load_json(file, "metrics", MAX_BYTES, "name another folder")
    settings = old.get("settings") if isinstance(old, dict) else None
    new, own = numbers.get("settings", {}), {"metrics", "notes"}
    if not new or not isinstance(settings, dict):
        return numbers
    if any(settings.get(key) != value for key, value in new.items() if key not in own):
        return numbers
    same = settings.get("metrics") == new["metrics"]
    kept = {key: old[key] for key in ("melanopic", *["undecided"] * same) if key in old}
    notes = {"notes": settings["notes"]} if "notes" in settings else {}
    return {**kept, **numbers, "settings": {**new, **notes}}


def plot(
    folder: Annotated[Path, argument("FOLDER", "Folder of an evaluation.")],
    point: Annotated[
        list[str] | None,
        option("X,Y[,Z]", "Year of the sensor nearest to it, as in plans [m]; repeatable."),
    ] = None,
    section: Annotated[
        str | None,
        option("X,Y,X,Y", "Ends of the section, as in plans [m]; by default across the room."),
    ] = None,
) -> None:
    """Draw the plots of an evaluation again, and further ones.

    Further ones are a mountain and a section of the mean illuminance, temporal maps (day × hour),
    and the path of the sun with the hours that close the shade.
    """
    from drcmitsuba.metrics import stored_arrays
    from drcmitsuba.report import figures, metrics_file, plots
    from drcmitsuba.report.year_figures import year_figures

    points = [lengths(text, (2, 3), "--point", "x,y or x,y,z") for text in point or ()]
    ends = None if section is None else lengths(section, (4,), "--section", "X,Y,X,Y")
    if ends is not None and ends[:2] == ends[2:]:
        raise InputError("command line", "--section", f"{section}, a point", "give two ends")
    path, file = folder / "illuminance.nc", folder / "metrics.json"
    E = stored_arrays.loaded(path, stored_arrays.open_dataset(path, "total", "direct_sun"))
    numbers = metrics_file.read_numbers(file, E.sizes["sensor"])
    case, error = metrics_file.case_of(numbers, file)
    if error is not None:
        show_notes([f"the plans have no rooms, since the model cannot be read: {error}"])
    line = None if ends is None else (ends[:2], ends[2:])
    drawn = figures.pictures(case, E, numbers)
    drawn |= year_figures(case, E, numbers, points=points, line=line)
    for picture in plots.save_all(drawn, folder):
        print(picture)
