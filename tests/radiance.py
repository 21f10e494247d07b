"""Radiance as the second opinion: a case's surfaces as its scene, and daylight coefficients by it.

The programs and function files are those of the `pyradiance` package; nothing else is installed.
Coefficients come back with our bins: ground, sky_001 … sky_145, or one per sun, shape
(repeat, sensor, bin) [sr].

Independent repeats are the sensors sent again in one run of one process, whose random numbers go
on. `-n 2` would not do, its processes draw the same numbers; nor would two runs within one second,
which is where the seed comes from.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.export.primitives import GLAZING, GLAZING_FILE, RadianceTwin, polygons, twin
from drcmitsuba.export.programs import RadiancePrograms, package_folder
from drcmitsuba.export.sources import SKY, SUN_RADIANCE, sun_modifiers, sun_text
from drcmitsuba.model.materials import BsdfMaterial, GlazingMaterial, Lambertian
from drcmitsuba.scene.geometry import Surface
from drcmitsuba.scene.scene import Scene
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.sky.weather import Site

RECEIVERS = """#@rfluxmtx h=u u=Y
void glow groundglow 0 0 4 1 1 1 0
groundglow source ground 0 0 4 0 0 -1 180
#@rfluxmtx h=r{subdivision} u=Y
void glow skyglow 0 0 4 1 1 1 0
skyglow source sky 0 0 4 0 0 1 180
"""


home = package_folder


def run(
    command: Sequence[str], folder: Path, stdin: bytes = b"", timeout: float | None = None
) -> bytes:
    """Output of a Radiance program of the package, run in a folder."""
    assert home() is not None, "pyradiance is not installed"
    return RadiancePrograms(home()).run(command, folder, stdin, timeout)


def glass(cos_theta: np.ndarray, transmissivity: float) -> tuple[np.ndarray, np.ndarray]:
    """Transmittance and reflectance of Radiance's `glass` (n = 1.52), both polarisations.

    With r Fresnel's reflectance of one face and d the light left after one pass inside,
    τ = (1 − r)² d / (1 − r² d²) and ρ = r (1 + (1 − 2r) d²) / (1 − r² d²).
    """
    n = 1.52
    c = np.maximum(cos_theta, 1e-6)
    inside = np.sqrt(1 - (1 - c**2) / n**2)
    d = transmissivity ** (1 / inside)
    faces = [((c - n * inside) / (c + n * inside)) ** 2, ((inside - n * c) / (inside + n * c)) ** 2]
    tau = sum((1 - r) ** 2 * d / (1 - (r * d) ** 2) for r in faces) / 2
    rho = sum(r * (1 + (1 - 2 * r) * d**2) / (1 - (r * d) ** 2) for r in faces) / 2
    return tau, rho


def transmissivity(tau: float) -> float:
    """Share of light left after one pass of a pane of transmittance tau, by bisection."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if glass(np.ones(1), middle)[0][0] < tau else (low, middle)
    return low


def _write_hours(
    times: np.ndarray, dni: np.ndarray, dhi: np.ndarray, site: Site, folder: Path
) -> None:
    """Write `hours.wea`; `times` are starts of hours, Radiance has the sun at their middle."""
    head = {
        "place": site.name.replace(" ", "_"), "latitude": site.latitude,
        "longitude": -site.longitude, "time_zone": -15 * site.timezone,
        "site_elevation": site.elevation, "weather_data_file_units": 1,
    }  # fmt: skip
    lines = [f"{key} {value}" for key, value in head.items()]
    for time, direct, diffuse in zip(times, dni, dhi, strict=True):
        date, clock = str(time.astype("datetime64[m]")).split("T")
        _, month, day = date.split("-")
        lines.append(f"{int(month)} {int(day)} {int(clock[:2]) + 0.5} {direct:.9g} {diffuse:.9g}")
    (folder / "hours.wea").write_text("\n".join(lines) + "\n")


def _sky_matrix(count: int, options: Sequence[str], folder: Path) -> np.ndarray:
    """Radiance (time, bin) of ground and patches by `gendaymtx` for the hours written before."""
    command = ["gendaymtx", "-h", "-c", "1", "1", "1", "-of", *options, "hours.wea"]
    values = np.frombuffer(run(command, folder), np.float32).reshape(-1, count, 3)
    return values[..., 0].T.astype(float)


def perez(
    times: np.ndarray, dni: np.ndarray, dhi: np.ndarray, site: Site, folder: Path
) -> tuple[np.ndarray, np.ndarray]:
    """Sky by `gendaymtx`: radiance (time, bin), and its sun (time, 3), for hours with sunshine.

    `times` are starts of hours; Radiance has the sun at their middle.
    """
    _write_hours(times, dni, dhi, site, folder)
    options = ["-m", "1", "-s", "-D", "suns.rad", "-M", "suns.txt"]
    values = _sky_matrix(len(times), options, folder)
    text = (folder / "suns.rad").read_text().split()
    starts = [i for i, word in enumerate(text) if word == "source"]
    suns = np.array([[float(v) for v in text[i + 5 : i + 8]] for i in starts])
    assert len(suns) == len(times), "gendaymtx prints a sun only where there is direct light"
    return values, suns


def sun_in_patches(
    times: np.ndarray, dni: np.ndarray, dhi: np.ndarray, site: Site, subdivision: int, folder: Path
) -> np.ndarray:
    """Radiance (time, bin) that `gendaymtx` gives patches for the sun: with it less without it."""
    _write_hours(times, dni, dhi, site, folder)
    options = ["-m", f"{subdivision}"]
    with_sun, without = (_sky_matrix(len(times), [*options, *s], folder) for s in ([], ["-s"]))
    return with_sun - without


def sun_moved_to_patch(
    times: np.ndarray, dni: np.ndarray, dhi: np.ndarray, site: Site, diameter: float, folder: Path
) -> np.ndarray:
    """Radiance (time, bin) of the sun's disk where the five-phase method has it: MF 6."""
    _write_hours(times, dni, dhi, site, folder)
    return _sky_matrix(len(times), ["-m", "6", "-d", "-5", f"{diameter:.9g}"], folder)


def patch_centres(subdivision: int, folder: Path) -> np.ndarray:
    """Centres (patch, 3) of Reinhart's patches by `reinsrc.cal`."""
    mf = ["-e", f"MF:{subdivision}", "-f", "reinsrc.cal"]
    last = float(run(["rcalc", "-n", *mf, "-e", "$1=Rmax"], folder))
    bins = "".join(f"{i}\n" for i in range(1, int(last) + 1)).encode()
    command = ["rcalc", *mf, "-e", "Rbin=$1", "-of", "-e", "$1=Dx;$2=Dy;$3=Dz"]
    return np.frombuffer(run(command, folder, bins), np.float32).reshape(-1, 3).astype(float)


def reciprocal(case: Case, folder: Path, *, reflects: bool = True) -> Case:
    """The case with its film's file without Transmission Back, which then follows by reciprocity.

    Radiance looks up the viewer as incident, so that component; sunlight calls for the other.
    `reflects`: keep the reflections, which Radiance samples without randomness at `-ss 0`.
    """
    name, film = next((k, m) for k, m in case.materials.items() if isinstance(m, BsdfMaterial))
    text = film.file.read_text()
    drop = "Transmission Back" if reflects else "Transmission Back|Reflection"
    for block in re.findall(r"<WavelengthData>.*?</WavelengthData>", text, re.DOTALL):
        if re.search(f"<WavelengthDataDirection>({drop})", block):
            text = text.replace(block, "")
    file = folder / f"reciprocal{reflects}.xml"
    file.write_text(text)
    kept = 3 if reflects else 1
    assert text.count("<WavelengthDataDirection>") == kept, film.file
    film = film.model_copy(update={"file": file})
    return case.model_copy(update={"materials": {**case.materials, name: film}})


def with_glass(scene: Scene, transmissivity: float) -> Scene:
    """The scene with clear panes that transmit and mirror as Radiance's `glass` does."""
    tau, rho = glass(np.linspace(0, 1, 1025), transmissivity)
    parameters = mi.traverse(scene.full)
    for key in parameters.keys():  # noqa: SIM118  iteration gives pairs
        for name, table in (("transmittance", tau), ("reflectance_", rho)):
            if f".bsdf.{name}" in key:
                parameters[key] = mi.TensorXf(table.astype(np.float32))
    parameters.update()
    return scene


def scene_text(
    surfaces: Sequence[Surface], transmissivity: float | None = None, *, black: bool = False
) -> str:
    """Surfaces as `export` writes them; clear panes are `glass` if its transmissivity is given.

    The modifier of surface i is m{i}.

    `black`: no surface reflects but films and glass.
    """
    lines = []
    for i, surface in enumerate(surfaces):
        material, modifier = surface.material, f"m{i}"
        file = material.file if isinstance(material, BsdfMaterial) else ""
        if black and isinstance(material, Lambertian):
            material = Lambertian(0.0)
        made = twin(modifier, material, surface.quads, file)
        if isinstance(material, GlazingMaterial) and transmissivity is not None:
            made = RadianceTwin(f"void glass {modifier} 0 0 3" + 3 * f" {transmissivity:.9g}")
        lines += [made.text, *polygons(modifier, material, surface.quads)]
    return "\n".join(lines) + "\n"


def numbered(directions: np.ndarray, diameter: float) -> Suns:
    """Suns sun0, sun1, … of a diameter [deg] in directions (sun, 3)."""
    return Suns(tuple(f"sun{i}" for i in range(len(directions))), directions, diameter)


@dataclass(frozen=True)
class Room:
    """A scene for Radiance and the sensors in it.

    Parameters
    ----------
    text : str
        Materials and geometry, without sources.
    points, normals : np.ndarray, shape (sensor, 3)
    folder : Path
        Where the octrees go.
    """

    text: str
    points: np.ndarray
    normals: np.ndarray
    folder: Path

    def _octree(self, name: str, sources: str) -> str:
        (self.folder / f"{name}.rad").write_text(self.text + sources)
        (self.folder / GLAZING_FILE).write_text(GLAZING)
        (self.folder / f"{name}.oct").write_bytes(run(["oconv", f"{name}.rad"], self.folder))
        return f"{name}.oct"

    def _suns_octree(self, directions: np.ndarray, diameter: float) -> str:
        """Octree of the room with suns, whose modifiers `suns.txt` then lists."""
        suns = numbered(directions, diameter)
        (self.folder / "suns.txt").write_text("\n".join(sun_modifiers(suns)) + "\n")
        return self._octree("suns", sun_text(suns))

    def _rays(self, repeats: int) -> bytes:
        rows = np.concatenate([self.points, self.normals], axis=1)
        text = "".join(" ".join(f"{v:.9g}" for v in row) + "\n" for row in rows)
        return (text * repeats).encode()

    def _matrix(self, output: bytes, repeats: int) -> np.ndarray:
        """First of the three equal channels of what came back."""
        values = np.frombuffer(output, np.float32).reshape(repeats, len(self.points), -1, 3)
        return values[..., 0].astype(float)

    def sky(self, options: Sequence[str], repeats: int = 1, subdivision: int = 1) -> np.ndarray:
        """Coefficients of ground and patches by `rcontrib`, (repeat, sensor, bin)."""
        octree = self._octree("sky", SKY)
        command = [
            "rcontrib", "-h", "-faf", "-I+", *options, "-e", f"MF:{subdivision}",
            "-f", "reinhart.cal", "-b", "rbin", "-bn", "Nrbins", "-m", "skyglow", octree,
        ]  # fmt: skip
        return self._matrix(run(command, self.folder, self._rays(repeats)), repeats)

    def sky_by_rfluxmtx(
        self, options: Sequence[str], repeats: int = 1, subdivision: int = 1
    ) -> np.ndarray:
        """The same by `rfluxmtx`, whose bins come from another function file."""
        octree = self._octree("room", "")
        (self.folder / "receivers.rad").write_text(RECEIVERS.format(subdivision=subdivision))
        command = [
            "rfluxmtx", "-h", "-faf", "-I+", *options, "-", "receivers.rad", "-i", octree,
        ]  # fmt: skip
        return self._matrix(run(command, self.folder, self._rays(repeats)), repeats)

    def suns(
        self, directions: np.ndarray, diameter: float, options: Sequence[str], repeats: int = 1
    ) -> np.ndarray:
        """Coefficients of suns by `rcontrib`, (repeat, sensor, sun)."""
        octree = self._suns_octree(directions, diameter)
        command = ["rcontrib", "-h", "-faf", "-I+", "-V+", *options, "-M", "suns.txt", octree]
        return self._matrix(run(command, self.folder, self._rays(repeats)), repeats) / SUN_RADIANCE

    def suns_by_rtrace(
        self, directions: np.ndarray, diameter: float, options: Sequence[str], repeats: int = 1
    ) -> np.ndarray:
        """The same by `rtrace`, one sun at a time."""
        command = ["rtrace", "-h", "-faf", "-I+", *options]
        parts = []
        for direction in directions:
            octree = self._octree("sun", sun_text(numbered(direction[None], diameter)))
            output = run([*command, octree], self.folder, self._rays(repeats))
            parts.append(self._matrix(output, repeats))
        return np.concatenate(parts, axis=-1) / SUN_RADIANCE

    def radiance_by_rtrace(
        self, directions: np.ndarray, diameter: float, options: Sequence[str]
    ) -> np.ndarray:
        """Radiance along the sensors' normals for suns of radiance 1, (sensor, sun)."""
        parts = []
        for direction in directions:
            octree = self._octree("sun", sun_text(numbered(direction[None], diameter)))
            output = run(["rtrace", "-h", "-faf", *options, octree], self.folder, self._rays(1))
            parts.append(self._matrix(output, 1)[0])
        return np.concatenate(parts, axis=-1) / SUN_RADIANCE
