"""The table `[output]` of a case: which spaces are evaluated, and what is kept."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from drcmitsuba.runtime.toml import Name, Table


class Output(Table):
    """Spaces and arrays of an evaluation."""

    spaces: Annotated[tuple[Name, ...], Field(max_length=1000)] = ()
    """Names of the spaces whose sensors are evaluated, `*` stands for any text; by default all
    sensors are."""

    illuminance: Literal["auto", "all", "metrics"] = "auto"
    """E of all hours and sensors, with C ("all"), or the metrics of each sensor alone ("metrics"),
    which takes little memory for any number of sensors; "auto" keeps all where it fits."""
