"""What a trade-off found, as a table that shows and saves itself."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from drcmitsuba.annual.tradeoff.deviation import Yardstick
from drcmitsuba.annual.tradeoff.picture import frontier
from drcmitsuba.annual.tradeoff.row import HEADER, Row
from drcmitsuba.case.case import Case
from drcmitsuba.report import plots
from drcmitsuba.runtime import storage


@dataclass(frozen=True)
class Tradeoff:
    """Errors and costs of the settings of one case; shows itself in Jupyter.

    Parameters
    ----------
    name : str
        Of the case.
    rows : tuple of Row
    own_rms, own_mean : float
        Errors of the reference itself: RMS of E, and of the mean E [%].
    mean : float
        Mean E of the reference [lx].
    sda, sda_error, ase : float
        Of the reference, on its hours [%].
    paths, rounds : int
        From every sensor, and the rounds that they were made in.
    reference_seconds : float
    hours, year : int
        Time stamps of the reference, and of the period.
    sensors : int
        Of the reference.
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
        storage.save_text(text, Path(folder) / "tradeoff.csv")

    def figure(self) -> Figure:
        """The frontier: seconds against the RMS error of E."""
        return frontier(self.name, self.rows, self.own_rms)

    def _repr_html_(self) -> str:
        buffer = BytesIO()
        self.figure().savefig(buffer, format="png", dpi=100)
        picture = base64.b64encode(buffer.getvalue()).decode()
        shown = pd.DataFrame([row.cells() for row in self.rows], columns=HEADER)
        told = "".join(f"<p>{note}</p>" for note in self.notes())
        image = f'<img alt="seconds against error" src="data:image/png;base64,{picture}">'
        return f"{shown.to_html(index=False, border=0)}{told}{image}"
