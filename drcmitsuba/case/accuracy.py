"""How accurately a case is simulated: samples, and what they are to reach."""

from __future__ import annotations

import re
from typing import Annotated, NamedTuple

from pydantic import Field, model_validator

from drcmitsuba.case.toml import Table, shortened
from drcmitsuba.runtime.errors import InputError


class Target(NamedTuple):
    """Half the width that a 95 % interval may have.

    Parameters
    ----------
    value : float
    unit : str
        "point": points of sDA and of ASE; "%": of the mean illuminance.
    """

    value: float
    unit: str

    @classmethod
    def parse(cls, text: str) -> Target:
        """Read "1 point", "0.5 points" or "2 %"."""
        found = re.fullmatch(r"\s*(\d{1,3}(?:\.\d{1,6})?)\s*(points?|%)\s*", text, re.ASCII)
        if found is None or not 0 < float(found[1]) <= 100:
            got = shortened(text)
            raise InputError("accuracy", "target", got, 'write "1 point" (of sDA, ASE) or "2 %"')
        return cls(float(found[1]), found[2].removesuffix("s"))

    def __str__(self) -> str:
        plural = "s" if self.unit == "point" and self.value != 1 else ""
        return f"{self.value:g} {self.unit}{plural}"


class Accuracy(Table):
    """Sampling: rays and points of each of the independent replicates."""

    seed: Annotated[int, Field(ge=0, le=1 << 30)] = 0
    replicates: Annotated[int, Field(ge=2, le=64)] = 8
    paths: Annotated[int, Field(ge=1, le=1 << 16)] = 128
    """Gather: paths from a sensor."""
    cell_size: Annotated[float, Field(ge=1e-3, le=100)] = 0.45
    cell_sky_rays: Annotated[int, Field(ge=1, le=1 << 16)] = 128
    """Deposit: rays from a cell to the sky."""
    sensor_sky_rays: Annotated[int, Field(ge=1, le=1 << 20)] = 2048
    """Deposit: rays from a sensor to the sky."""
    sensor_sun_samples: Annotated[int, Field(ge=1, le=1 << 10)] = 4
    """Deposit: directions from a sensor to every sun; a cell takes one."""
    pane_points: Annotated[int, Field(ge=1, le=1 << 16)] = 64
    """Deposit: points on the scattering panes that a sensor or a cell looks at."""
    film_sky_samples: Annotated[int, Field(ge=1, le=1 << 16)] = 256
    """Deposit: directions to the sky from every outgoing cell of a film."""
    photons: Annotated[int, Field(ge=1, le=1 << 22)] = 1024
    """Deposit: photons of every sun to each component; of a patch of the sky four times as many."""
    photon_surfaces: Annotated[int, Field(ge=2, le=10_000)] = 256
    """Surfaces that a photon is followed over; what is still under way is told as lost."""
    sensor_square: Annotated[float, Field(gt=0, le=10)] = 0.3
    """Edge of the square around a sensor that photons are counted on [m], at most."""
    target: str | None = None
    """Half the width of the 95 % intervals to reach: "1 point" of sDA and ASE, "2 %" of mean E."""
    time_limit: Annotated[float, Field(gt=0, le=1e6)] = 600.0
    """Seconds that may be spent on further samples for the target; the round in flight ends."""

    @model_validator(mode="after")
    def _target_is_readable(self) -> Accuracy:
        _ = self.goal
        return self

    @property
    def goal(self) -> Target | None:
        """The target, taken apart."""
        return None if self.target is None else Target.parse(self.target)
