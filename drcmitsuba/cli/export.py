"""The command `drcmitsuba export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from drcmitsuba.cli.options import Weather, argument, file_option, folder_option, load, option
from drcmitsuba.cli.terminal import show_notes, stages
from drcmitsuba.runtime.errors import InputError

SCENE = "CASE: scene, sensors, sources and script for Radiance."
MATRICES = "RESULTS: C and L as .mtx whose product is E."
ILL = "RESULTS: E as DAYSIM writes it (.ill)."


def export(
    source: Annotated[
        str, argument("CASE|RESULTS", "Case for Radiance, or folder of an evaluation.")
    ],
    radiance: Annotated[Path | None, folder_option("--radiance", SCENE)] = None,
    matrices: Annotated[Path | None, folder_option("--matrices", MATRICES)] = None,
    ill: Annotated[Path | None, file_option("--ill", ILL)] = None,
    csv: Annotated[Path | None, file_option("--csv", "RESULTS: E as CSV.")] = None,
    weather: Weather = None,
    state: Annotated[
        str,
        option("NAME", "State in Radiance: open, shaded, or of each group."),
    ] = "open",
) -> None:
    """Write a case, or the results of an evaluation, for other programs."""
    tables = {"--matrices": matrices, "--ill": ill, "--csv": csv}
    of_results = [name for name, path in tables.items() if path is not None]
    if radiance is None and not of_results:
        remedy = "choose --radiance, --matrices, --ill or --csv"
        raise InputError("command line", "export", "it does not say as what", remedy)
    if radiance is None:
        if weather is not None or state != "open":
            name = "--weather" if weather is not None else "--state"
            got = "results have their own weather and states"
            raise InputError("command line", name, got, "give it beside --radiance alone")
        _export_results(Path(source), matrices, ill, csv)
        return
    if of_results:
        got = "it wants a folder of results, --radiance a case"
        raise InputError("command line", of_results[0], got, "export them one after the other")
    _export_case(source, radiance, weather, state)


def _export_case(source: str, folder: Path, weather: Path | None, state: str) -> None:
    from drcmitsuba.export.radiance import save_radiance
    from drcmitsuba.runtime import backend

    case = load(source, weather)
    backend.select()
    with stages() as stage, stage("writing"):
        simulation = save_radiance(case, folder, state)
    show_notes([*simulation.notes, *simulation.remarks])
    print(f"{folder / 'simulate.sh'} simulates the case by Radiance")


def _export_results(
    results: Path, matrices: Path | None, ill: Path | None, csv: Path | None
) -> None:
    from drcmitsuba.export import tables
    from drcmitsuba.export.matrices import save_matrices
    from drcmitsuba.metrics import stored_arrays

    if matrices is not None:
        with stages() as stage, stage("writing"):
            states, sky = stored_arrays.coefficients_and_sky(
                results / "coefficients.zarr", results / "sky.zarr"
            )
            made = save_matrices(states, sky, matrices)
        print(f"C.mtx ({len(made.C)} sensors × {len(made.bins)} bins) and L.mtx are in {matrices}")
    if ill is None and csv is None:
        return
    path = results / "illuminance.nc"
    E = stored_arrays.open_dataset(path, "total", "time", *"xyz")
    with stages() as stage, stage("writing"):
        E = stored_arrays.loaded(path, E[["total"]])
        for save, file in ((tables.save_ill, ill), (tables.save_csv, csv)):
            if file is not None:
                save(E, file)
    print(*(f"E is in {file}" for file in (ill, csv) if file is not None), sep="\n")
