"""Commands about the program: `drcmitsuba schema`, `doctor`, `new`."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import Annotated

from rich.table import Table

from drcmitsuba.cli.options import argument
from drcmitsuba.cli.terminal import show
from drcmitsuba.runtime.errors import InputError


def schema() -> None:
    """Print the JSON schema of the case file: every key, its unit and its limits."""
    from drcmitsuba.case.case import Case

    print(json.dumps(Case.model_json_schema(), indent=2))


def doctor() -> None:
    """Report backend, LLVM, GPU and versions, and whether and how fast the program runs here."""
    from drcmitsuba.runtime import backend, machine_speed

    table = Table(show_header=False)
    for name, value in backend.report().items():
        table.add_row(name, value)
    show(table)
    print(f"ready: {backend.select()}")
    here = machine_speed.speed()
    print(f"speed: {here.rays:.1f} × rays, {here.host:.1f} × Python of {machine_speed.MACHINE}")


def new(
    file: Annotated[Path, argument("FILE", "Name of the case file.")] = Path("case.toml"),
) -> None:
    """Write a commented case file to start from."""
    text = (resources.files("drcmitsuba.case") / "new.toml").read_text(encoding="utf-8")
    if file.suffix.lower() != ".toml" or file.is_dir():
        raise InputError(file, "file", "no name of a TOML file", "give a name such as case.toml")
    try:
        with file.open("x", encoding="utf-8") as opened:
            opened.write(text)
    except FileExistsError:
        got = "the file exists"
        raise InputError(file, "file", got, "give another name; nothing is overwritten") from None
    print(f"{file}: a room to change; next: drcmitsuba evaluate {file}")
