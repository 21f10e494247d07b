"""The classroom with open windows, its converged coefficients, and the error of an estimate."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

import numpy as np

from drcmitsuba.annual.bench.reference import (
    PATHS,
    CoefficientErrors,
    KnownCoefficients,
    known,
    trace_halves,
)
from drcmitsuba.annual.bench.room import BINS, CASE, NO_SUNS, BenchRoom
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.sky.sun_models import Suns
from tests import radiance

__all__ = [
    "BINS",
    "CASE",
    "NO_SUNS",
    "Classroom",
    "CoefficientErrors",
    "KnownCoefficients",
    "reference",
]

GENEVA = "shared/data/weather/CHE_Geneva.067000_IWEC.epw"


def best_weather() -> Path | None:
    """The Geneva year of the published comparison, where it lies beside the repository."""
    file = Path(__file__).resolve().parents[3] / GENEVA
    return file if file.is_file() else None


@dataclass(frozen=True)
class Classroom(BenchRoom):
    """The package's own room in the best weather, also for a Radiance of many repeats."""

    weather: Path | None = field(default_factory=best_weather)

    def room(self, folder: Path) -> radiance.Room:
        """Radiance gets this room."""
        return radiance.Room(radiance.scene_text(surfaces_of(self.case)), *self.sensors, folder)


def reference(
    room: Classroom, suns: Suns | None, rounds: int, folder: Path | None
) -> KnownCoefficients:
    """Reference for the sky (`suns` None) or for suns, from a folder if it holds it."""
    kind = "sky" if suns is None else "suns"
    weather = room.weather.stem if room.weather else "default"
    file = folder / f"{kind}_{weather}_{room.picked}_{rounds}.npz" if folder else None
    if file is not None and file.is_file():
        with np.load(file) as saved:
            direct, halves = saved["direct"], saved["halves"]
    else:
        start = perf_counter()
        direct, halves = trace_halves(room, suns, rounds, lambda share: None)
        seconds = perf_counter() - start
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            np.savez(file, direct=direct, halves=halves)
        print(f"Reference for the {kind}: made in {seconds:.0f} s.")
    result = known(direct, halves)
    print(
        f"Reference for the {kind}: {rounds * PATHS} paths per sensor, own RMS "
        f"{result.own_error:.1%}; {result.agreement}.\n"
    )
    return result
