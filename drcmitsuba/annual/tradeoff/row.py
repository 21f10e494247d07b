"""One setting in the table of a trade-off."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from drcmitsuba.annual.tradeoff.deviation import Errors

NOT_RUN = "not run"


@dataclass(frozen=True)
class Row:
    """A setting: what was changed, whether it ran, and what it cost.

    Parameters
    ----------
    name, varied : str
        As in `settings.Setting`.
    status : str
        "done", "not run", or "failed: …".
    errors : Errors or None
    seconds : float
        Of the whole period.
    memory : int
        [bytes].
    """

    name: str
    varied: str
    status: str = NOT_RUN
    errors: Errors | None = None
    seconds: float = math.nan
    memory: int = 0

    @property
    def is_on_plot(self) -> bool:
        """Whether its E could be compared."""
        return self.errors is not None and not math.isnan(self.errors.square.value)

    def as_dict(self) -> dict[str, Any]:
        """The row of the CSV file."""
        out: dict[str, Any] = {"setting": self.name, "varied": self.varied, "status": self.status}
        if self.errors is not None:
            e = self.errors
            out |= {
                "E_rms_percent": e.rms,
                "E_rms_se": e.rms_error,
                "E_rms_below": e.rms_below,
                "E_mean_percent": e.mean.value,
                "E_mean_se": e.mean.error,
                "sDA_points": e.sda.value,
                "ASE_points": e.ase.value,
                "direct_sun_wrong_percent": e.direct_sun.value,
                "shade_wrong_percent": e.shade.value,
                "seconds": round(self.seconds, 3),
                "memory_MiB": round(self.memory / 2**20),
            }
        return out

    def cells(self) -> tuple[str, ...]:
        """The row of the table on a terminal."""
        if self.errors is None:
            return self.name, self.status, *[""] * 6
        e = self.errors
        rms = f"< {e.rms_below:.1f}" if e.is_hidden else f"{e.rms:.1f}"
        return (
            self.name,
            _number(e.square.value, rms),
            _number(e.mean.value, _signed(e.mean.value)),
            _signed(e.sda.value),
            _signed(e.ase.value),
            _number(e.direct_sun.value, f"{e.direct_sun.value:.2f}"),
            f"{self.seconds:.1f}",
            f"{self.memory / 2**30:.1f}",
        )


def _signed(value: float) -> str:
    """One decimal with its sign; nothing is 0.0."""
    text = f"{value:+.1f}"
    return "0.0" if float(text) == 0 else text


def _number(value: float, text: str) -> str:
    return "–" if math.isnan(value) else text


HEADER = (
    "setting", "E RMS %", "E mean %", "sDA points", "ASE points", "direct sun %", "seconds", "GiB",
)  # fmt: skip
"""Columns of `Row.cells`."""
