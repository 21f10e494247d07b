"""The commands about films: `drcmitsuba bsdf`, `drcmitsuba goniophotometer`."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli.options import AsJson, Depth, FilmOutput, film_path, named
from drcmitsuba.cli.terminal import show, stages
from drcmitsuba.runtime.errors import InputError


def bsdf(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help="BSDF file (.xml), or measurements (PAB-opto text)."),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="NAME",
            parser=named,
            help="Folder for pictures and JSON; with measurements, the film's .xml.",
        ),
    ] = None,
    sun: Annotated[
        tuple[float, float],
        typer.Option(
            metavar="ELEVATION AZIMUTH",
            help="Sun of the pictures, its azimuth from the façade's normal [deg].",
        ),
    ] = (45.0, 0.0),
    as_json: AsJson = False,
    depth: Depth = 5,
    symmetry: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="Measured sample: auto, bilateral, quadrilateral or none."
        ),
    ] = "auto",
    front: Annotated[
        str,
        typer.Option(metavar="SIDE", help="Measured sample: side that its front (θ < 90°) faces."),
    ] = "room",
) -> None:
    """Check and show a BSDF file; or turn goniophotometer measurements into one."""
    from drcmitsuba import bsdf as library
    from drcmitsuba.bsdf import check, writer
    from drcmitsuba.report import plots
    from drcmitsuba.runtime import storage

    if not math.isfinite(sum(sun)) or not (0 <= sun[0] <= 90 and -90 < sun[1] < 90):
        got = f"{sun[0]:g} {sun[1]:g}"
        raise InputError("command line", "--sun", got, "elevation 0 … 90, azimuth −90 … 90 deg")
    if all(f.suffix.lower() != ".xml" for f in files):
        from drcmitsuba.bsdf import measured

        path = film_path(output)
        with stages() as stage, stage("interpolation") as progress:
            film = measured.from_measurements(
                files, depth=depth, symmetry=symmetry, front=front, progress=progress
            )
            writer.save(film, path)
        print(f"{path}: {film.kind}; see `drcmitsuba bsdf {path}`")
        return
    if len(files) > 1:
        raise InputError(files[1], "files", f"{len(files)} came", "give one BSDF file at a time")
    film = library.read(files[0])
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
        from drcmitsuba.bsdf import pictures

        output.mkdir(parents=True, exist_ok=True)
        storage.save_json(report.to_dict(), output / "bsdf.json")
        for name, figure in pictures.figures(film, report, sun).items():
            plots.save(figure, output / name)
        if not as_json:
            print(f"pictures are in {output}")


def goniophotometer(
    recipe: Annotated[
        str,
        typer.Argument(
            metavar="RECIPE", help="Micro-structure (TOML), or a shipped one: films/prism."
        ),
    ],
    output: FilmOutput = None,
    depth: Depth = 5,
    rank: Annotated[
        int, typer.Option(metavar="NUMBER", help="Rank of the tree: 4, or 3 (isotropic).")
    ] = 4,
    samples: Annotated[
        int, typer.Option(metavar="NUMBER", help="Number of rays from each incident cell.")
    ] = 4096,
    seed: Annotated[int, typer.Option(metavar="NUMBER", help="Seed of the random numbers.")] = 0,
    percent: Annotated[
        float, typer.Option(metavar="NUMBER", help="Share of possible merges of cells [%].")
    ] = 90.0,
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
    print(f"{path}: {film.kind}; see `drcmitsuba bsdf {path}`")
