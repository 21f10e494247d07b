"""Arguments and options that several commands share, each defined once."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer.models import ArgumentInfo, OptionInfo

from drcmitsuba.runtime.errors import InputError

if TYPE_CHECKING:
    from drcmitsuba.case.case import Case

FILES = {
    ".csv", ".epw", ".json", ".nc", ".obj", ".png", ".pdf", ".rad", ".svg", ".tm2", ".toml",
    ".txt", ".wea", ".xml", ".zarr", ".zip",
}  # fmt: skip
"""File endings that a folder for results may not have."""


def named(text: str) -> Path:
    """Path of an option; an empty text, which would mean the current folder, is refused."""
    if not str(text).strip():
        raise typer.BadParameter("the name is empty; give a name")
    return Path(text)


def _writable(param: typer.CallbackParam, folder: Path | None) -> Path | None:
    """Refuse a folder that cannot be written, before any work is done."""
    if folder is not None:
        name = param.opts[0]
        there = next(p for p in (folder, *folder.absolute().parents) if p.exists())
        if not there.is_dir():
            raise InputError(folder, name, f"{there} is a file", "name a folder")
        if there != folder and folder.suffix.lower() in FILES:
            got = f"the name of a {folder.suffix} file"
            raise InputError(folder, name, got, "name a folder, in which the files get their names")
        if not os.access(there, os.W_OK | os.X_OK):
            raise InputError(folder, name, f"{there} may not be written", "name another folder")
    return folder


def _file(param: typer.CallbackParam, path: Path | None) -> Path | None:
    """Refuse a file that cannot be written, before any work is done."""
    if path is not None:
        if path.is_dir():
            raise InputError(path, param.opts[0], "it is a folder", "give the name of a file")
        if not path.absolute().parent.is_dir():
            raise InputError(path, param.opts[0], f"there is no folder {path.parent}", "make it")
    return path


def argument(metavar: str, text: str) -> ArgumentInfo:
    """Argument with its name in the help, and the text of the help."""
    return typer.Argument(metavar=metavar, help=text)


def option(metavar: str, text: str, *names: str) -> OptionInfo:
    """Option with the name of its value in the help, the text of the help, and names of its own.

    One whose value is named as its parameter needs a name: typer 0.27 would make it `--TIME`.
    """
    return typer.Option(*names, metavar=metavar, help=text)


def _output(metavar: str, text: str, is_folder: bool = False) -> OptionInfo:
    """Option -o; a folder is checked before any work is done."""
    check = _writable if is_folder else None
    return typer.Option("-o", "--output", metavar=metavar, parser=named, callback=check, help=text)


def folder_option(name: str, text: str) -> OptionInfo:
    """Option for a folder to write, which is checked before any work is done."""
    return typer.Option(name, metavar="FOLDER", parser=named, callback=_writable, help=text)


def file_option(name: str, text: str) -> OptionInfo:
    """Option for a file to write, which is checked before any work is done."""
    return typer.Option(name, metavar="FILE", parser=named, callback=_file, help=text)


CaseName = Annotated[str, argument("CASE", "Case file (TOML), or a shipped case by name.")]
Weather = Annotated[
    Path | None,
    typer.Option(
        "--weather", metavar="FILE", parser=named, help="Weather file in place of the case's own."
    ),
]
Output = Annotated[Path, _output("FOLDER", "Folder for the results.", is_folder=True)]
JSON_FOLDER = "Folder for the JSON file; without it, nothing is written."
OptionalOutput = Annotated[Path | None, _output("FOLDER", JSON_FOLDER, is_folder=True)]
ANY_FOLDER = "Folder for pictures and JSON; with measurements, the film's .xml."
AnyOutput = Annotated[Path | None, _output("NAME", ANY_FOLDER)]
REPORT = "The report, .html, .md or .csv; by default report.html in the first folder."
ReportOutput = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="FILE", parser=named, callback=_file, help=REPORT),
]
FilmOutput = Annotated[Path | None, _output("FILE", "The film's .xml.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON in place of the table.")]
Cache = Annotated[
    Path | None,
    option("FOLDER", "Keep coefficients for any weather, thresholds, schedules and cases."),
]
WorkerCount = Annotated[
    int | None, typer.Option("--workers", metavar="N", help="Processes on this machine.")
]
Scheduler = Annotated[
    str | None,
    option("ADDRESS", "Dask scheduler whose workers do the work: tcp://host:8786."),
]
Depth = Annotated[int, option("NUMBER", "Levels of the tensor tree.")]


def lengths(text: str, counts: tuple[int, ...], name: str, form: str) -> list[float]:
    """Finite lengths [m] of an option such as "1,2", of one of these numbers."""
    try:
        numbers = [float(number) for number in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not all(map(math.isfinite, numbers)):
        raise InputError("command line", name, repr(text), f"give {name} {form} in metres")
    return numbers


def film_path(path: Path | None) -> Path:
    """Refuse a path to which no film can be written, before any work is done."""
    if path is None:
        raise InputError("command line", "-o", "nothing", "name the film: -o film.xml")
    if path.suffix.lower() != ".xml" or path.is_dir():
        raise InputError(path, "-o", "no name of an XML file", "name the film: -o film.xml")
    if not path.absolute().parent.is_dir():
        raise InputError(path, "-o", f"there is no folder {path.parent}", "make it first")
    return path


def load(case: str, weather: Path | None) -> Case:
    """Load a case; `weather`, where it is given, replaces the case's weather file."""
    from drcmitsuba.case.reading import load_case
    from drcmitsuba.runtime.toml import is_file

    if weather is not None and not (weather.is_dir() or is_file(weather, weather, "file")):
        raise InputError(weather, "file", "no such file", "give the path of a file")
    return load_case(case).with_weather(weather)
