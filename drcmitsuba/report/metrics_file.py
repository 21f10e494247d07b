"""Numbers of `metrics.json` that pictures and reports need, read as untrusted input."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, Field, ValidationError

from drcmitsuba.metrics import Interval
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


Months = Annotated[list[Share | None], Field(min_length=12, max_length=12)]


class GridNumbers(BaseModel):
    """Numbers of a grid that the pictures need."""

    sDA: Share  # noqa: N815
    ASE: Share


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
    settings: dict[str, Any]


def read_numbers(file: Path, sensors: int) -> dict[str, Any]:
    """Read `metrics.json`.

    Raises
    ------
    InputError
        The file is missing, is no JSON, lacks a number, or has another number of sensors.
    """
    remedy = "run evaluate again"
    try:
        if file.exists() and not (file.is_file() and file.stat().st_size <= MAX_BYTES):
            raise InputError(file, "metrics", "no plain file, or too large a one", remedy)
        numbers = json.loads(file.read_text(encoding="utf-8"))
        read = Numbers.model_validate(numbers)
    except InputError:
        raise
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        got = f"{'.'.join(map(str, first['loc']))}, {first['msg'][:120]}"
        raise InputError(file, "metrics", got, remedy) from None
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(file, "metrics", str(error)[:120], remedy) from None
    if any(u.sensor >= sensors for u in read.undecided):
        got = f"there are {sensors} sensors in illuminance.nc"
        raise InputError(file, "undecided", got, remedy)
    return {**numbers, **read.model_dump()}
