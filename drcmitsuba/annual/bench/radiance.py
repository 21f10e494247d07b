"""Coefficients of the bench's room by Radiance, with the seconds that they take.

The files are those of `export --radiance`, the options the fastest that are known at their error;
see docs/validation/radiance.md.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.export.programs import RadiancePrograms
from drcmitsuba.export.radiance import save_radiance
from drcmitsuba.export.sources import SUN_RADIANCE, sun_modifiers, sun_text
from drcmitsuba.sky.sun_models import Suns

SKY_OPTIONS = "-ab 7 -ad 4096 -lw 1e-4"
SUN_OPTIONS = "-ab 5 -ad 512 -lw 1e-3 -dt 0 -dc 1"
OTHER_PROGRAMS = {
    "accelerad_rcontrib": "Accelerad",
    "honeybee-radiance": "Honeybee",
    "gen_dc": "DAYSIM",
}
"""Programs that answer the same question, by their command."""


def other_programs() -> list[str]:
    """Other programs on the PATH, which are named in the table and not run."""
    return [f"{name} (`{word}`)" for word, name in OTHER_PROGRAMS.items() if shutil.which(word)]


@dataclass(frozen=True)
class RadianceRoom:
    """A case exported to a folder, for programs of Radiance.

    Parameters
    ----------
    programs : RadiancePrograms
    folder : Path
        Where the files are.
    sensors : int
        Number of sensors.
    processes : int
        Number of processes that `rcontrib` takes.
    """

    programs: RadiancePrograms
    folder: Path
    sensors: int
    processes: int

    @classmethod
    def of(
        cls, programs: RadiancePrograms, case: Case, folder: Path, processes: int
    ) -> RadianceRoom:
        """Export a case to a new folder."""
        simulation = save_radiance(case, folder)
        return cls(programs, folder, simulation.sensors, processes)

    def sky(self, options: str) -> tuple[np.ndarray, float]:
        """Coefficients (sensor, bin) [sr] of ground and patches, and the seconds."""
        bins = "-e MF:1 -f reinhart.cal -b rbin -bn Nrbins -m skyglow"
        return self._traced("sky", [*options.split(), *bins.split()])

    def suns(self, suns: Suns, options: str) -> tuple[np.ndarray, float]:
        """Coefficients (sensor, sun) [sr] of suns, and the seconds, `oconv` included."""
        (self.folder / "picked.rad").write_text(sun_text(suns), encoding="ascii")
        names = "".join(f"{name}\n" for name in sun_modifiers(suns))
        (self.folder / "picked.txt").write_text(names, encoding="ascii")
        C, seconds = self._traced("picked", ["-V+", *options.split(), "-M", "picked.txt"])
        return C / SUN_RADIANCE, seconds

    def _traced(self, sources: str, arguments: Sequence[str]) -> tuple[np.ndarray, float]:
        rays = (self.folder / "sensors.pts").read_bytes()
        start = perf_counter()
        files = ["materials.rad", "scene.rad", f"{sources}.rad"]
        octree = self.programs.run(["oconv", *files], self.folder)
        (self.folder / "room.oct").write_bytes(octree)
        command = ["rcontrib", "-n", str(self.processes), "-h", "-faf", "-I+"]
        answer = self.programs.run([*command, *arguments, "room.oct"], self.folder, rays)
        seconds = perf_counter() - start
        values = np.frombuffer(answer, np.float32).reshape(self.sensors, -1, 3)
        return values[..., 0].astype(float), seconds
