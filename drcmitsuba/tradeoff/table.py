"""What a trade-off found, as a table that shows and saves itself."""

from __future__ import annotations

import math
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import pandas as pd

from drcmitsuba import plots, schema
from drcmitsuba.case import Case
from drcmitsuba.tradeoff.deviation import Errors, Yardstick

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
            _number(e.mean.value, f"{e.mean.value:+.1f}"),
            f"{e.sda.value:+.1f}",
            f"{e.ase.value:+.1f}",
            _number(e.direct_sun.value, f"{e.direct_sun.value:.2f}"),
            f"{self.seconds:.1f}",
            f"{self.memory / 2**30:.1f}",
        )


def _number(value: float, text: str) -> str:
    return "–" if math.isnan(value) else text


HEADER = (
    "setting", "E RMS %", "E mean %", "sDA points", "ASE points", "direct sun %", "seconds", "GiB",
)  # fmt: skip


@dataclass(frozen=True)
class Tradeoff:
    """Errors and costs of the settings of one case; shows itself in Jupyter.

    Parameters
    ----------
    name : str
        Of the case.
    rows : tuple of Row
    own : Row-like numbers of the reference
        `own_rms`, `own_mean` [%], `sda`, `sda_error`, `ase` [%], `paths`, `seconds`.
    hours, year : int
        Time stamps of the reference, and of the period.
    """

    name: str
    rows: tuple[Row, ...]
    own_rms: float
    own_mean: float
    mean: float
    sda: float
    sda_error: float
    ase: float
    paths: int
    rounds: int
    reference_seconds: float
    hours: int
    year: int
    sensors: int

    @classmethod
    def of(cls, case: Case, yardstick: Yardstick, year: int, rows: tuple[Row, ...]) -> Tradeoff:
        """Take what is told about the reference from it."""
        ref = yardstick.reference
        return cls(
            name=case.name,
            rows=rows,
            own_rms=yardstick.own_rms,
            own_mean=100 * yardstick.mean.error / yardstick.mean.value,
            mean=yardstick.mean.value,
            sda=yardstick.sda.value,
            sda_error=yardstick.sda.error,
            ase=yardstick.ase,
            paths=ref.paths,
            rounds=yardstick.count,
            reference_seconds=ref.seconds,
            hours=len(ref.times),
            year=year,
            sensors=len(ref.sensors),
        )

    @property
    def frame(self) -> pd.DataFrame:
        """All numbers; the reference with its own errors comes first."""
        reference = {
            "setting": "reference",
            "varied": "reference",
            "status": "done",
            "E_rms_percent": self.own_rms,
            "E_mean_se": self.own_mean,
            "seconds": round(self.reference_seconds, 3),
        }
        return pd.DataFrame([reference, *(row.as_dict() for row in self.rows)])

    def notes(self) -> list[str]:
        """What a reader of the numbers has to know, a sentence each."""
        return [
            f"Reference: unbiased path tracing, {self.paths} paths from each of {self.sensors} "
            f"sensors in {self.rounds} rounds, {self.reference_seconds:.0f} s; its own error is "
            f"{self.own_rms:.1f} % RMS and {self.own_mean:.2f} % of the mean, {self.mean:.0f} lx. "
            "Its noise is taken off the errors; '<' is an upper bound (95 %).",
            f"Errors are those of {self.hours} of {self.year} time stamps, E in the same state of "
            f"the shade. sDA ({self.sda:.1f} ± {1.96 * self.sda_error:.1f} %) and ASE "
            f"({self.ase:.1f} %) are those of these hours, by the rules of the year.",
            "Seconds are those of the whole period, without start-up and compilation.",
        ]

    def save(self, folder: str | Path) -> None:
        """Write `tradeoff.csv` and `tradeoff.png`, each whole or not at all."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        self.save_csv(folder)
        plots.save(self.figure(), folder / "tradeoff.png")

    def save_csv(self, folder: str | Path) -> None:
        """Write `tradeoff.csv`, whole or not at all."""
        text = self.frame.to_csv(index=False, float_format="%.6g")
        schema.save_text(text, Path(folder) / "tradeoff.csv")

    def figure(self) -> Any:
        """The frontier: seconds against the RMS error of E."""
        from drcmitsuba.tradeoff.picture import frontier

        return frontier(self)

    def _repr_png_(self) -> bytes:
        buffer = BytesIO()
        self.figure().savefig(buffer, format="png", dpi=100)
        return buffer.getvalue()

    def _repr_html_(self) -> str:
        shown = pd.DataFrame([row.cells() for row in self.rows], columns=HEADER)
        told = "".join(f"<p>{note}</p>" for note in self.notes())
        return f"{shown.to_html(index=False, border=0)}{told}"
