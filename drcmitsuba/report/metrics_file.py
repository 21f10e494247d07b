"""Numbers of `metrics.json` that pictures and reports need, read as untrusted input."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Field, ValidationError

from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import case_of_settings, with_files
from drcmitsuba.metrics import Interval
from drcmitsuba.runtime import backend, storage
from drcmitsuba.runtime.errors import InputError

MAX_BYTES = 1 << 26


def _of_shares(interval: Interval) -> Interval:
    if not 0 <= interval.low <= interval.value <= interval.high <= 100:
        raise ValueError("not 0 ≤ low ≤ value ≤ high ≤ 100")
    return interval


Share = Annotated[Interval, AfterValidator(_of_shares)]


class Undecided(BaseModel):
    """A sensor whose count is too close to a metric's limit to be decided."""

    sensor: Annotated[int, Field(ge=0)]
    metric: str
    probability: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]


Amount = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]
Months = Annotated[list[Share | None], Field(min_length=12, max_length=12)]


class GridNumbers(BaseModel):
    """Numbers of a grid that the pictures need."""

    sDA: Share  # noqa: N815
    ASE: Share


class EyeRule(BaseModel):
    """Verdict on a rule of melanopic light."""

    met: Literal["yes", "no", "open"]
    mornings: Share
    threshold: Amount
    source: str
    sure: str


class MelanopicLight(BaseModel):
    """Melanopic light at sensors, or at a view."""

    autonomy: Share
    ratio: Amount | None = None
    cct: Amount | None = None
    duv: float | None = None
    fidelity: float | None = None
    gamut: float | None = None


class MelanopicView(MelanopicLight):
    """Melanopic light at a view."""

    mornings: Share
    rules: dict[str, EyeRule] = {}


class Melanopic(MelanopicLight):
    """Melanopic light of a case with bands."""

    threshold: Amount
    sensors: Share
    views: dict[str, MelanopicView] = {}


class Numbers(BaseModel):
    """Numbers of `metrics.json` that the pictures need; the file holds more."""

    sDA: Share  # noqa: N815
    ASE: Share
    shade_closed: Share
    msDA: Months  # noqa: N815
    MSE: Months
    shade_closed_monthly: Months
    undecided: list[Undecided] = []
    grids: dict[str, GridNumbers] = {}
    melanopic: Melanopic | None = None
    settings: dict[str, Any]


def read_numbers(file: Path, sensors: int) -> dict[str, Any]:
    """Read `metrics.json`.

    Raises
    ------
    InputError
        The file is missing, is no JSON, lacks a number, or has another number of sensors.
    """
    remedy = "run evaluate again"
    numbers = storage.load_json(file, "metrics", MAX_BYTES, remedy)
    try:
        read = Numbers.model_validate(numbers)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        got = f"{'.'.join(map(str, first['loc']))}, {first['msg'][:120]}"
        raise InputError(file, "metrics", got, remedy) from None
    if any(u.sensor >= sensors for u in read.undecided):
        got = f"there are {sensors} sensors in illuminance.nc"
        raise InputError(file, "undecided", got, remedy)
    return {**numbers, **read.model_dump()}


def case_of(numbers: dict[str, Any], file: Path) -> tuple[Case, InputError | None]:
    """Case of an evaluation, and why its model cannot be read, if it cannot.

    Raises
    ------
    InputError
        The settings in the file make no case.
    """
    case = case_of_settings(numbers["settings"], file)
    if case.model is not None:
        try:
            case = with_files(case)
            backend.select()
        except InputError as error:
            return case, error
    return case, None
