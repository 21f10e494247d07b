"""The table `[output]` of a case: what an evaluation keeps."""

from __future__ import annotations

from typing import Literal

from drcmitsuba.runtime.toml import Table


class Output(Table):
    """Arrays that an evaluation keeps."""

    illuminance: Literal["auto", "all", "metrics"] = "auto"
    """E of all hours and sensors, with C ("all"), or the metrics of each sensor alone ("metrics"),
    which takes little memory for any number of sensors; "auto" keeps all where it fits."""
