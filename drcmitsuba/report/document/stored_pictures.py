"""Pictures and glare that stand beside an evaluation in its folder."""

from __future__ import annotations

import base64
import io
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, ValidationError

from drcmitsuba.metrics import Interval
from drcmitsuba.report.document.labels import labels
from drcmitsuba.report.document.table import NONE, Cell, PageTable, interval, plain, share, text
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError

OWN = ("monthly.png", "[!g]*_plan.png", "lights_*.png", ".*")
"""Pictures that the page draws itself from numbers."""
OF_GLARE = "glare_*.png"
"""Pictures that the command `glare` draws."""
AT_ONCE = 2.0
"""Time within which the files of a folder are copied, in any order [s]."""
MOST_PICTURES = 6
"""Largest number of pictures of a façade."""
MOST_VIEWS = 40
"""Largest number of views in the table of glare."""
LARGEST_FILE = 1 << 25
"""Largest file of a picture, or of glare, that is read [bytes]."""
SEEN = (
    "room", "model", "facade", "materials", "components", "furniture", "shading", "groups",
    "weather_source", "site", "sky", "outside", "period", "sun", "sensors", "spaces", "effects",
    "colour", "inputs",
)  # fmt: skip
"""Tables of a case that glare depends on."""
OTHER_GLARE = "glare.json is of another façade, room, sky, period or view, and left out"
WIDTH = 720
"""Largest width and height of a picture in the page [pixel]."""
MOST_PIXELS = 1 << 26


@dataclass(frozen=True)
class PagePicture:
    """Picture of a page."""

    name: str
    address: str
    """Content as a `data:` address."""


def pictures(folder: Path, most: int, *, glare: bool = True) -> list[PagePicture]:
    """Pictures (PNG) of a folder, made small; together at most so many characters.

    Files that are no picture are left out, and those of glare without `glare`.
    """
    out = []
    for path in _others(folder):
        if not glare and fnmatch(path.name, OF_GLARE):
            continue
        address = _small(path)
        if address is None or len(address) > most:
            continue
        most -= len(address)
        out.append(PagePicture(text(path.stem), address))
        if len(out) == MOST_PICTURES:
            break
    return out


def older_pictures(folder: Path) -> tuple[str, ...]:
    """Note pictures that are older than the evaluation of their folder."""
    evaluated = min((folder / n).stat().st_mtime for n in ("metrics.json", "illuminance.nc"))
    names = [p.name for p in _others(folder) if p.stat().st_mtime < evaluated - AT_ONCE]
    named = ", ".join(text(name) for name in names[:MOST_PICTURES])
    return (f"older than the evaluation, maybe of another façade: {named}",) if names else ()


def _others(folder: Path) -> list[Path]:
    """Pictures of a folder that an evaluation does not draw."""
    every = sorted(folder.glob("*.png"))
    own = (any(fnmatch(path.name, pattern) for pattern in OWN) for path in every)
    return [path for path, drawn in zip(every, own, strict=True) if not drawn and path.is_file()]


def _small(path: Path) -> str | None:
    """Address of a small copy of a picture; None where it cannot be read."""
    from PIL import Image

    if not path.is_file() or path.stat().st_size > LARGEST_FILE:
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a picture of very many pixels is a warning first
            with Image.open(path, formats=["PNG"]) as image:
                if image.width * image.height > MOST_PIXELS:
                    return None
                small = image.convert("RGB")
    except Exception:
        return None
    small.thumbnail((WIDTH, WIDTH))
    buffer = io.BytesIO()
    small.save(buffer, "JPEG", quality=82, optimize=True)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode()}"


class _View(BaseModel):
    """Glare of a view in `glare.json`."""

    above: Annotated[dict[str, Interval], Field(max_length=8)]
    rating: Annotated[str, Field(alias="class", max_length=100)]
    probability: Annotated[dict[str, float], Field(max_length=8)]
    space: Annotated[str, Field(max_length=1000)] = ""


class _WorstView(_View):
    """Glare of the worst view of a space."""

    worst: Annotated[str, Field(max_length=1000)]


class StoredGlare(BaseModel):
    """Content of `glare.json`, as far as the report shows it."""

    DGP: dict[str, dict[str, _View]]
    spaces: dict[str, dict[str, _WorstView]] = {}
    settings: dict[str, Any] = {}


def stored_glare(
    folder: Path, settings: Mapping[str, Any]
) -> tuple[StoredGlare | None, tuple[str, ...]]:
    """Read `glare.json` of a folder, and notes; None where there is none of these `settings`.

    Raises
    ------
    InputError
        It is damaged.
    """
    path = folder / "glare.json"
    if not path.exists():
        return None, ()
    remedy = "run drcmitsuba glare again"
    content = storage.load_json(path, "glare", LARGEST_FILE, remedy)
    try:
        glare = StoredGlare.model_validate(content)
        known = glare.settings
        if known and not _is_of(known, settings):
            return None, (OTHER_GLARE,)
        return glare, ()
    except ValidationError as error:
        got = str(error).splitlines()[0][:120]
        raise InputError(path, "glare", got, remedy) from None


def _is_of(known: Mapping[str, Any], settings: Mapping[str, Any]) -> bool:
    """Whether glare of some settings is that of a case; views around a place are in no case."""
    views, own = (each.get("views") or {} for each in (known, settings))
    same = all(views[name] == own[name] for name in views.keys() & own.keys())
    return same and all(known.get(table) == settings.get(table) for table in SEEN)


def glare_tables(glare: StoredGlare, name: str) -> list[PageTable]:
    """Tables of the hours with glare of every view, by state of the façade; where the views lie in
    spaces, the worst view of each in the last state before them.
    """
    t, tables = labels(), []
    for state, spaces in [*glare.spaces.items()][-1:]:
        worst = [
            ((plain(space), plain(of.worst), plain(state)), of) for space, of in spaces.items()
        ]
        title = t["worst_views"].format(facade=name)
        tables += [_glare_table(title, (t["space"], t["view"], t["state"]), worst)] if worst else []
    in_spaces = any(of.space for views in glare.DGP.values() for of in views.values())
    rows = []
    for state, views in glare.DGP.items():
        for view, of in views.items():
            place = (plain(of.space or NONE),) if in_spaces else ()
            rows.append(((plain(view), *place, plain(state)), of))
    head = (t["view"], *((t["space"],) if in_spaces else ()), t["state"])
    return [*tables, _glare_table(name, head, rows)]


def _glare_table(
    title: str, names: tuple[str, ...], views: Sequence[tuple[tuple[Cell, ...], _View]]
) -> PageTable:
    """Table of the hours with glare, with `names` of the columns before them."""
    t = labels()
    limits = list(dict.fromkeys(limit for _, of in views for limit in of.above))
    rows = [
        (
            *words, *(interval(of.above[k].to_dict() if k in of.above else None) for k in limits),
            plain(of.rating), (share(of.probability.get(of.rating)),),
        )
        for words, of in views[:MOST_VIEWS]
    ]  # fmt: skip
    above = (t["glare_above"].format(limit=text(k)) for k in limits)
    more = len(views) - MOST_VIEWS
    note = t["more_views"].format(count=more) if more > 0 else ""
    return PageTable(title, (*names, *above, t["glare_class"], t["probability"]), tuple(rows), note)
