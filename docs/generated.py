"""Pages that are made from the program: case file, command line, picture of the rooms."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import typer
from matplotlib.figure import Figure

import drcmitsuba
from drcmitsuba.case.case import Case
from drcmitsuba.cli.main import app_of

PACKAGE = Path(drcmitsuba.__file__).parent


def write(folder: Path) -> None:
    """Write all generated pages below `folder`; files whose text is unchanged are not touched."""
    _save(folder / "reference" / "case_keys.md", case_keys())
    _save(folder / "reference" / "command_line.md", command_line())
    draw_rooms(folder / "_static" / "rooms.svg")


def _save(path: Path, text: str) -> None:
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def case_keys() -> str:
    """Reference of every table and key of a case file, from its JSON schema."""
    schema = Case.model_json_schema()
    tables = schema["$defs"]
    pages = [
        "# Every key of the case file",
        "This page is generated from the schema that `drcmitsuba schema` prints. Lengths are in "
        "metres, angles in degrees; a key without a default must be given.",
        _table("The case", schema),
    ]
    pages += [_table(f"{name}", table) for name, table in tables.items() if "properties" in table]
    return "\n\n".join(pages) + "\n"


def _table(title: str, schema: dict[str, Any]) -> str:
    required = set(schema.get("required", ()))
    rows = ["| key | type | default | meaning |", "|---|---|---|---|"]
    for key, value in schema["properties"].items():
        default = "required" if key in required else f"`{value.get('default')}`"
        if isinstance(value.get("default"), dict):
            default = "its own defaults"
        meaning = " ".join(str(value.get("description", "")).split())
        rows.append(f"| `{key}` | {_type(value)} | {default} | {_plain(meaning)} |")
    text = " ".join(str(schema.get("description", "")).split("\n\n")[0].split())
    return f"## {title}\n\n{_plain(text)}\n\n" + "\n".join(rows)


def _type(value: dict[str, Any]) -> str:
    """Type of a key in words."""
    if "$ref" in value:
        name = value["$ref"].rsplit("/", 1)[-1]
        return f"[{name}](#{name.lower()})"
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f"`{item}`" for item in value["enum"])
    for key in ("anyOf", "oneOf"):
        if key in value:
            return " or ".join(_type(item) for item in value[key] if item.get("type") != "null")
    if value.get("type") == "array":
        items = value.get("items") or {"type": "value"}
        return f"list of {_type(items)}"
    if value.get("type") == "object":
        inner = value.get("additionalProperties")
        return f"tables of {_type(inner)}" if isinstance(inner, dict) else "table"
    return str(value.get("type", "value"))


def _plain(text: str) -> str:
    """Text that Markdown does not read as a table's bar or as HTML."""
    return text.replace("|", "\\|").replace("<", "&lt;")


def command_line() -> str:
    """Reference of all verbs, from the same declarations that the command line runs."""
    group = typer.main.get_command(app_of())
    pages = [
        "# Command line",
        "This page is generated from the program. Exit codes: 0 success (also when a time limit "
        "was reached), 1 internal error or unfit backend, 2 bad input, 130 stopped by Ctrl-C or "
        "SIGTERM.",
    ]
    for name, command in sorted(group.commands.items()):  # type: ignore[attr-defined]
        pages.append(_verb(name, command))
    return "\n\n".join(pages) + "\n"


def _verb(name: str, command: Any) -> str:
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    options = [p for p in command.params if p.param_type_name == "option"]
    usage = " ".join([name, *map(_name, arguments)])
    help_text = _plain((command.help or "").replace("\f", "").strip())
    rows = ["| argument or option | default | meaning |", "|---|---|---|"]
    for p in (*arguments, *options):
        label = ", ".join(p.opts) if p in options else _name(p)
        shown = "" if p.default is None or callable(p.default) else f"`{p.default}`"
        default = "required" if p.required else shown
        rows.append(f"| `{label}` | {default} | {_plain(getattr(p, 'help', None) or '')} |")
    table = "\n".join(rows) if len(rows) > 2 else ""
    return f"## `{usage}`\n\n{help_text}\n\n{table}".rstrip()


def _name(argument: Any) -> str:
    return argument.metavar or argument.name.upper()


def draw_rooms(path: Path) -> None:
    """Draw the rooms of the package by floor, with the imports between them, as SVG."""
    imports = _room_imports()
    floors: dict[str, int] = {}
    while len(floors) < len(imports):
        for room, below in imports.items():
            if room not in floors and below <= floors.keys():
                floors[room] = 1 + max((floors[other] for other in below), default=0)
    figure = Figure(figsize=(9, 1.0 * max(floors.values())))
    ax = figure.add_axes((0, 0, 1, 1))
    ax.set_axis_off()
    place = {}
    for floor in range(1, max(floors.values()) + 1):
        rooms = [room for room, at in floors.items() if at == floor]
        for i, room in enumerate(rooms):
            place[room] = ((i + 1) / (len(rooms) + 1) + 0.06 * (floor % 2 - 0.5), -floor)
    for room, below in imports.items():
        for other in below:
            if not any(other in imports[third] for third in below):  # only the nearest floors
                (x, y), (u, v) = place[room], place[other]
                ax.annotate("", (x, y + 0.18), (u, v - 0.18), arrowprops={"arrowstyle": "->"})
    for room, (x, y) in place.items():
        box = {"boxstyle": "round,pad=0.5", "fc": "#eef3f8", "ec": "#345"}
        ax.text(x, y, room, ha="center", va="center", bbox=box, fontsize=12, family="monospace")
    ax.set_xlim(0, 1)
    ax.set_ylim(-max(floors.values()) - 0.5, -0.5)
    path.parent.mkdir(exist_ok=True)
    with matplotlib.rc_context({"svg.hashsalt": "rooms"}):
        figure.savefig(path, metadata={"Date": None})


def _room_imports() -> dict[str, set[str]]:
    """Rooms that each room imports, read from the source."""
    imports: dict[str, set[str]] = {}
    for file in PACKAGE.rglob("*.py"):
        room = file.relative_to(PACKAGE).parts[0].removesuffix(".py")
        is_data = (PACKAGE / room).is_dir() and not (PACKAGE / room / "__init__.py").is_file()
        if room.startswith("__") or is_data:  # an installed package holds the shipped scenes
            continue
        names = imports.setdefault(room, set())
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("drcmitsuba."):
                names.add(str(node.module).split(".")[1])
            elif isinstance(node, ast.ImportFrom) and node.module == "drcmitsuba":
                names |= {a.name for a in node.names if (PACKAGE / a.name).is_dir()}
                names |= {a.name for a in node.names if a.name == "schema"}
    return {room: names - {room} for room, names in imports.items()}
