"""The command `drcmitsuba report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drcmitsuba.cli.options import ReportOutput, argument
from drcmitsuba.runtime.errors import InputError

HTML, MARKDOWN, CSV = (".html", ".htm"), (".md",), (".csv",)


def report(
    folders: Annotated[list[Path], argument("RESULTS", "Folders of evaluations, side by side.")],
    output: ReportOutput = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="Write the tables only.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Write the numbers only.")] = False,
) -> None:
    """Write a report for clients: one page of HTML, at most 2 MB, that needs no network.

    It shows verdicts with their probability, plans, months, all hours and the year of every point,
    of one or several façades side by side. Nothing is simulated again.
    """
    from drcmitsuba.report.document import Report

    path = _path(folders, output, markdown, csv)
    made = Report.of_folders(folders)
    if path.is_dir():
        raise InputError(path, "report", "it is a folder", "name a file: -o report.html")
    print(f"the report is in {made.save(path)}")


def _path(folders: list[Path], output: Path | None, markdown: bool, csv: bool) -> Path:
    """Path of the report, whose ending agrees with the options."""
    if markdown and csv:
        raise InputError("command line", "--csv", "beside --markdown", "give one of them")
    endings = MARKDOWN if markdown else CSV if csv else (*HTML, *MARKDOWN, *CSV)
    if output is None:
        return folders[0] / f"report{endings[0]}"
    if output.suffix.lower() not in endings:
        remedy = f"name a file that ends in {', '.join(endings)}"
        raise InputError(output, "-o", "no name of such a file", remedy)
    return output
