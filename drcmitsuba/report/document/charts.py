"""Charts of the months, as shapes of SVG."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby

from drcmitsuba.report.captions import MONTHS, month_names
from drcmitsuba.report.document.facade import EvaluatedFacade
from drcmitsuba.report.document.labels import labels
from drcmitsuba.report.document.tables import MONTHLY, has_shade

WIDTH, HEIGHT, LEFT, TOP = 460, 200, 34, 24
"""Panel and its place [px]."""


@dataclass(frozen=True)
class Line:
    """Metric by month: pieces of its line and of its band, broken where a month has no hours."""

    key: str
    label: str
    pieces: tuple[str, ...]
    bands: tuple[str, ...]
    dots: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Chart:
    """Months of a façade."""

    title: str
    lines: tuple[Line, ...]
    months: tuple[tuple[float, str], ...]
    levels: tuple[tuple[float, int], ...]
    """Height of every grid line [px], and its share [%]."""
    extremes: str
    """Months with the least daylight and with the most sun, in words."""


def months(facade: EvaluatedFacade, name: str) -> Chart:
    """Chart of the metrics of a façade by month."""
    shown = MONTHLY if has_shade(facade) else MONTHLY[:2]
    ticks = tuple((_x(i), month) for i, month in enumerate(MONTHS))
    levels = tuple((_y(share), share) for share in range(0, 101, 25))
    lines = tuple(_line(key, facade.numbers[key]) for key in shown)
    title = labels()["months_chart"].format(facade=name)
    return Chart(title, lines, ticks, levels, _extremes(facade))


def _extremes(facade: EvaluatedFacade) -> str:
    """Months with the least enough daylight, and with the most points in too much sun."""
    t, words = labels(), []
    for key, phrase, extreme in (("msDA", "months_least", min), ("MSE", "months_most", max)):
        known = [(v["value"], i) for i, v in enumerate(facade.numbers[key], 1) if v is not None]
        if known:
            value, month = extreme(known)
            words.append(t[phrase].format(month=month_names((month,)), value=f"{value:.1f}"))
    return " ".join(words)


def _x(month: int) -> float:
    return round(LEFT + WIDTH * (month + 0.5) / 12, 1)


def _y(share: float) -> float:
    return round(TOP + HEIGHT * (1 - share / 100), 1)


def _line(key: str, values: list[Mapping[str, float] | None]) -> Line:
    runs = list(_runs(values))
    line = (" ".join(f"{_x(i)},{_y(v['value'])}" for i, v in run) for run in runs)
    band = (
        " ".join(
            [f"{_x(i)},{_y(v['high'])}" for i, v in run]
            + [f"{_x(i)},{_y(v['low'])}" for i, v in reversed(run)]
        )
        for run in runs
    )
    dots = tuple((_x(i), _y(v["value"])) for run in runs for i, v in run)
    return Line(key, labels()[key], tuple(line), tuple(band), dots)


def _runs(
    values: list[Mapping[str, float] | None],
) -> Iterator[list[tuple[int, Mapping[str, float]]]]:
    """Neighbouring months that have values."""
    for known, run in groupby(enumerate(values), lambda item: item[1] is not None):
        if known:
            yield [(i, v) for i, v in run if v is not None]
