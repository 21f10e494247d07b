"""The report: one page of HTML that needs no network, Markdown, or CSV."""

from __future__ import annotations

import base64
import csv
import hashlib
import io
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from drcmitsuba.report.document import charts, record, spaces, stored_lights, tables, verdicts
from drcmitsuba.report.document.facade import EvaluatedFacade
from drcmitsuba.report.document.hours import Hours
from drcmitsuba.report.document.labels import labels
from drcmitsuba.report.document.light_of_sensors import PackedLight, shares
from drcmitsuba.report.document.plans import MOST_CORNERS, MOST_POINTS, plans, shown_points
from drcmitsuba.report.document.stored_pictures import (
    OTHER_GLARE,
    PagePicture,
    glare_tables,
    pictures,
)
from drcmitsuba.report.document.table import LINE, Number, PageTable, text
from drcmitsuba.report.lights import of_period
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError

OTHERS = (".pdf", ".docx", ".odt", ".tex", ".txt", ".json", ".xlsx")
"""Endings of formats that no report has."""
MOST_FACADES = 12
"""Largest number of façades of a report."""
LARGEST_PAGE = 2_000_000
"""Largest size of a page [bytes]."""
MOST_OF_PICTURES = 0.25
"""Largest share of a page that pictures take [–]."""
MOST_DOMES = 24
"""Largest number of points whose sky domes are drawn."""
MARGIN = 20_000
"""Part of it that is left free: characters of more than one byte, braces and keys [bytes]."""
MARKDOWN = str.maketrans({c: f"\\{c}" for c in "\\`*_[]<>|#"} | {LINE: "; "})
FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""First characters of cells that spreadsheets would compute."""


def _environment() -> Environment:
    env = Environment(
        loader=PackageLoader("drcmitsuba.report.document"),
        autoescape=lambda name: bool(name and name.endswith(".html")),
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    env.tests["exact"] = lambda part: isinstance(part, Number)
    env.filters["markdown"] = lambda cell: "".join(str(p).translate(MARKDOWN) for p in cell)
    env.filters["words"] = lambda words: str(words).translate(MARKDOWN)
    return env


def _file(name: str) -> str:
    folder = resources.files("drcmitsuba.report.document").joinpath("templates")
    return folder.joinpath(name).read_text(encoding="utf-8")


def _digest(content: str) -> str:
    """Hash by which a page allows its own script and style, and no others."""
    return "sha256-" + base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()


@dataclass(frozen=True, eq=False)
class Report:
    """Report on one or several façades; shows itself in Jupyter."""

    facades: list[EvaluatedFacade]

    @classmethod
    def of_folders(cls, folders: Iterable[str | Path]) -> Report:
        """Read folders that `evaluate -o FOLDER` wrote.

        Raises
        ------
        InputError
            A file is missing or damaged, or of another version; there are too many folders.
        """
        folders = list(folders)
        if not 0 < len(folders) <= MOST_FACADES:
            remedy = f"give 1 to {MOST_FACADES}"
            raise InputError("report", "folders", str(len(folders)), remedy)
        with ThreadPoolExecutor(1) as thread:  # one façade is judged while the next one is read
            judged = [thread.submit(EvaluatedFacade.of_folder(folder)) for folder in folders]
        return cls([facade.result() for facade in judged])

    @cached_property
    def names(self) -> list[str]:
        """Names of the façades; equal ones have a number."""
        names = [text(f.case.name) or "–" for f in self.facades]
        count, so_far = Counter(names), Counter[str]()
        for i, name in enumerate(names):
            so_far[name] += 1
            if count[name] > 1:
                names[i] = f"{name} ({so_far[name]})"
        return names

    @cached_property
    def _each(self) -> list[tuple[EvaluatedFacade, str]]:
        return list(zip(self.facades, self.names, strict=True))

    @cached_property
    def _content(self) -> dict[str, Any]:
        """Content of the templates without what the script draws."""

        def known(every: Iterable[PageTable | None]) -> list[PageTable]:
            return [table for table in every if table is not None]

        t = labels()
        if any(facade.light_of_sensors is not None for facade in self.facades):
            t = {**t, "point": t["point_lit"]}
        return {
            "t": t,
            "names": self.names,
            "asked": tables.asked(self.facades, self.names),
            "metrics": tables.metrics(self.facades, self.names),
            "differences": known([tables.differences(self.facades, self.names)]),
            "months": [tables.months(*each) for each in self._each],
            "charts": [charts.months(*each) for each in self._each],
            "spaces": known(spaces.table(*each) for each in self._each),
            "groups": known(tables.groups(*each) for each in self._each),
            "melanopic": known(tables.melanopic(*each) for each in self._each),
            "verdicts": verdicts.overview(self.facades, self.names),
            "judgements": [verdicts.judgements(*each) for each in self._each],
            "lights": [
                stored_lights.table(f.lights, name)
                for f, name in self._each
                if f.lights is not None
            ],
            "glare": [
                each for f, name in self._each if f.glare for each in glare_tables(f.glare, name)
            ],
            "plan": known(record.plan(*each) for each in self._each),
            "versions": record.versions(self.facades, self.names),
            "notes": [(name, record.notes(facade)) for facade, name in self._each],
            "validation": record.validation(),
        }

    def html(self) -> str:
        """One page of HTML, at most about 2 MB, with its own script, style and arrays."""
        style, script = _file("page.css"), _file("page.js")
        shown = [shown_points(f, MOST_POINTS // len(self.facades)) for f in self.facades]
        corners = MOST_CORNERS // len(self.facades)
        facades = [
            {
                "name": name, "count": facade.illuminance.sizes["sensor"],
                **plans(facade, points, corners), "lights": self._domes(facade),
                "lit_by": _light_of(facade, points),
            }
            for (facade, name), points in zip(self._each, shown, strict=True)
        ]  # fmt: skip
        page = _environment().get_template("page.html")
        content = {
            **self._content, "style": style, "script": script,
            "style_digest": _digest(style), "script_digest": _digest(script),
            "pictures": self._pictures(),
        }  # fmt: skip
        drawn = {"labels": labels(), "facades": facades}
        size = len(page.render(content, drawn=drawn).encode()) + MARGIN
        most = (LARGEST_PAGE - size) // len(facades)
        with ThreadPoolExecutor(2) as threads:
            every = [Hours(*each) for each in zip(self.facades, shown, strict=True)]
            for facade, hours in zip(
                facades, threads.map(lambda h: h.to_dict(most), every), strict=True
            ):
                facade["hours"] = hours
        return page.render(content, drawn=drawn)

    def _domes(self, facade: EvaluatedFacade) -> dict[str, Any] | None:
        if facade.lights is None:
            return None
        return stored_lights.domes(facade.lights, MOST_DOMES // len(self.facades))

    def _pictures(self) -> list[tuple[str, list[PagePicture]]]:
        """Pictures of every façade that has some, by its name."""
        most = int(MOST_OF_PICTURES * LARGEST_PAGE) // len(self.facades)
        every = [
            (name, pictures(f.folder, most, glare=OTHER_GLARE not in f.notes))
            for f, name in self._each
            if f.folder is not None
        ]
        return [(name, some) for name, some in every if some]

    def markdown(self) -> str:
        """Tables of the report as Markdown."""
        return _environment().get_template("page.md").render(self._content)

    def csv(self) -> str:
        """Metrics, lights and glare with all their digits as CSV: one row for each number."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(["facade", "space", "month", "metric", "value", "low", "high", "unit"])
        for facade, name in self._each:
            for row in (*_numbers(facade), *_lights(facade), *_glare(facade)):
                writer.writerow([_inert(name), *row])
        return out.getvalue()

    def save(self, path: str | Path) -> Path:
        """Write the page to a file, whole or not at all; `.md` and `.csv` choose another format.

        Raises
        ------
        InputError
            The path has the ending of another format.
        """
        path = Path(path)
        if (ending := path.suffix.lower()) in OTHERS:
            raise InputError(path, "report", ending, "end its name in .html, .md or .csv")
        made = {".md": self.markdown, ".csv": self.csv}.get(ending, self.html)
        storage.save_text(made(), path)
        return path

    def _repr_html_(self) -> str:
        """Page in a frame of its own, which has no access to the notebook."""
        page = escape(self.html(), quote=True)
        frame = 'sandbox="allow-scripts" width="100%" height="900"'
        return f'<iframe title="{escape(labels()["title"])}" {frame} srcdoc="{page}"></iframe>'


def _light_of(facade: EvaluatedFacade, shown: np.ndarray) -> PackedLight | None:
    known = facade.light_of_sensors
    return None if known is None else shares(known, shown)


def _numbers(facade: EvaluatedFacade) -> Iterator[list[Any]]:
    """Space, month, metric, value, low, high and unit of every metric."""
    keys = ("value", "low", "high")
    for metric in ("sDA", "ASE", "shade_closed"):
        yield ["", "", metric, *(facade.numbers[metric][key] for key in keys), "%"]
    for metric in tables.MONTHLY:
        for month, number in enumerate(facade.numbers[metric], start=1):
            if number is not None:
                yield ["", month, metric, *(number[key] for key in keys), "%"]
    told = spaces.told_rows(facade.numbers, "spaces")
    parts = {space.get("name", ""): space for space in told} if len(told) > 1 else {}
    for name, numbers in (parts or facade.numbers.get("grids", {})).items():
        for metric in ("sDA", "ASE"):
            yield [_inert(text(name)), "", metric, *(numbers[metric][key] for key in keys), "%"]
        for metric, values, unit in spaces.numbers_of_task(numbers):
            yield [_inert(text(name)), "", metric, *values, *[""] * (3 - len(values)), unit]


def _lights(facade: EvaluatedFacade) -> Iterator[list[Any]]:
    """The same of the light of every traced point by window, source and number of bounces."""
    if facade.lights is None:
        return
    light = of_period(facade.lights).transpose("sensor", "window", "source", "bounces")
    for index, value in np.ndenumerate(light.values):
        sensor, window, source = (
            str(light[dim].values[i]) for dim, i in zip(light.dims[:3], index[:3], strict=True)
        )
        metric = text(f"light from {source} by {window} after {index[3]} bounces")
        yield [f"point {sensor}", "", metric, float(value), "", "", "lx h"]


def _glare(facade: EvaluatedFacade) -> Iterator[list[Any]]:
    """The same of the hours with glare of every view, and the probability of its class."""
    for state, views in ({} if facade.glare is None else facade.glare.DGP).items():
        for view, of in views.items():
            place = _inert(text(view))
            for limit, hours in of.above.items():
                metric = text(f"DGP above {limit}, {state}")
                yield [place, "", metric, hours.value, hours.low, hours.high, "%"]
            for name, share in of.probability.items():
                metric = text(f"probability of class {name}, {state}")
                yield [place, "", metric, 100 * share, "", "", "%"]


def _inert(name: str) -> str:
    """Name that a spreadsheet does not take for a formula."""
    return f"'{name}" if name.startswith(FORMULA) else name
