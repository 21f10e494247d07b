"""The commands about films: `drcmitsuba bsdf`, `drcmitsuba goniophotometer`."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated

from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli.options import AnyOutput, AsJson, Depth, FilmOutput, argument, film_path, option
from drcmitsuba.cli.terminal import show, show_notes, stages
from drcmitsuba.runtime.errors import InputError


def bsdf(
    files: Annotated[
        list[Path], argument("FILE", "BSDF file (.xml), or measurements (PAB-opto text).")
    ],
    output: AnyOutput = None,
    sun: Annotated[
        tuple[float, float],
        option(
            "ELEVATION AZIMUTH", "Sun of the pictures, its azimuth from the façade's normal [deg]."
        ),
    ] = (45.0, 0.0),
    as_json: AsJson = False,
    depth: Depth = 5,
    symmetry: Annotated[
        str, option("NAME", "Measured sample: auto, bilateral, quadrilateral or none.")
    ] = "auto",
    front: Annotated[
        str, option("SIDE", "Measured sample: side that its front (θ < 90°) faces.")
    ] = "room",
) -> None:
    """Check and show a BSDF file; or turn goniophotometer measurements into one."""
    if not math.isfinite(sum(sun)) or not (0 <= sun[0] <= 90 and -90 < sun[1] < 90):
        got = f"{sun[0]:g} {sun[1]:g}"
        raise InputError("command line", "--sun", got, "elevation 0 … 90, azimuth −90 … 90 deg")
    if all(f.suffix.lower() != ".xml" for f in files):
        from drcmitsuba.bsdf import measured, writer

        path = film_path(output)
        with stages() as stage, stage("interpolation") as progress:
            film = measured.from_measurements(
                files, depth=depth, symmetry=symmetry, front=front, progress=progress
            )
            writer.save(film, path)
        print(f"{path}: {film.kind}; see `drcmitsuba bsdf {path}`")
    elif len(files) > 1:
        raise InputError(files[1], "files", f"{len(files)} came", "give one BSDF file at a time")
    else:
        _show_film(files[0], output, sun, as_json)


def _show_film(file: Path, output: Path | None, sun: tuple[float, float], as_json: bool) -> None:
    """Check a BSDF file, and show it under a sun at elevation and azimuth [deg]."""
    from drcmitsuba.bsdf import check, pictures, read
    from drcmitsuba.report import plots
    from drcmitsuba.runtime import storage

    film = read(file)
    report = check.check(film)
    if as_json:
        print(json.dumps(report.to_dict(), indent=2))
    else:
        table = Table(show_header=False)
        table.add_column(no_wrap=True)
        table.add_column(overflow="fold")
        for row in report.rows():
            table.add_row(*map(escape, row))
        show(table)
    if output is not None:
        storage.save_json(report.to_dict(), output / "bsdf.json")
        plots.save_all(pictures.figures(film, report, sun), output)
        if not as_json:
            print(f"pictures are in {output}")


def goniophotometer(
    recipe: Annotated[
        str, argument("RECIPE", "Micro-structure (TOML), or a shipped one: films/prism.")
    ],
    output: FilmOutput = None,
    depth: Depth = 5,
    rank: Annotated[int, option("NUMBER", "Rank of the tree: 4, or 3 (isotropic).")] = 4,
    samples: Annotated[int, option("NUMBER", "Number of rays from each incident cell.")] = 4096,
    seed: Annotated[int, option("NUMBER", "Seed of the random numbers.")] = 0,
    percent: Annotated[float, option("NUMBER", "Share of possible merges of cells [%].")] = 90.0,
) -> None:
    """Measure a micro-structure virtually: a tensor-tree BSDF."""
    from drcmitsuba import goniophotometer as library
    from drcmitsuba.bsdf import writer
    from drcmitsuba.case.shipped import shipped_folder, shipped_recipes
    from drcmitsuba.runtime import backend
    from drcmitsuba.scene.structures.structure import unit_cell

    path = film_path(output)
    shipped = shipped_folder() / f"{recipe}.toml"
    loaded = library.load_recipe(shipped if recipe in shipped_recipes() else recipe)
    backend.select()
    with stages() as stage, stage("rays") as progress:
        film = library.measure(
            loaded, depth=depth, rank=rank, samples=samples, seed=seed, percent=percent,
            progress=progress,
        )  # fmt: skip
        writer.save(film, path, thickness=unit_cell(loaded).thickness * 1e-3)
    show_notes(film.notes[2:])  # after its settings and its recipe
    print(f"{path}: {film.kind}; see `drcmitsuba bsdf {path}`")
