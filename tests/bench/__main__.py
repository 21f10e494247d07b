"""Time and error of ours and of Radiance, in one run on one machine.

    python -m tests.bench [--parts a,b,c,d,e,f] [--reference DIR] [--weather FILE] [--quick]

from the repository's root, with the test extras installed; prints Markdown.

(a) Sky coefficients of the classroom: seconds at equal error, light between surfaces by paths or
    solved on cells, whichever is faster.
(b) Exact suns of a year: seconds at equal error; Radiance's for 100 suns, times suns over 100.
(c) A whole evaluation as a user starts it, import and compilation included; memory and disk.
(d) Seconds against the number of sensors.
(e) Suns of a year by way of a film (O2): as (b), by `rtrace` for one sun at a time, 4 of them, and
    by `rcontrib -V+` for 100, these among them.
(f) Photons by mirror lamellae: segments a second against bare closest hits; the year of the case
    `lamella` as a user starts it, and its errors; and a small room against `mkpmap -apC` with
    `rcontrib -ap`, each at the equal error of the other: seconds × (ratio of errors)².

Equal error: ours is at most Radiance's, over all entries, and in further rows also over those
without direct light; against converged coefficients, which take minutes to make and are kept in the
folder that `--reference` names; in (e) by a long run of ours, and "direct" is straight light. In
(a), (b), (d) and (e) kernels are warm and the import is not counted;
`oconv`, milliseconds, is in Radiance's seconds. `rcontrib` has two processes. CPU seconds tell more
where the machine has other work, too. Nothing is asserted.
`--quick` is a rehearsal of minutes: a coarse reference and small searches.
"""

from __future__ import annotations

import argparse
import datetime
import itertools
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.annual.bench.run import machine
from drcmitsuba.runtime import backend
from drcmitsuba.schema import positions
from drcmitsuba.sky.sun_models import Suns
from tests import radiance
from tests.bench import films, photons
from tests.bench.classroom import (
    BINS,
    CASE,
    NO_SUNS,
    Classroom,
    CoefficientErrors,
    KnownCoefficients,
    reference,
)

PROCESSES = ["-n", "2"]
SKY = {
    "-ad 4096 -ab 7 -lw 1e-9": "nothing cut off",
    "-ad 4096 -ab 7 -lw 1e-4": "fastest found at this error",
}
SUNS = {
    "-dt 0 -dc 1 -ab 5 -ad 512 -lw 1e-9": "nothing cut off",
    "-dt 0 -dc 1 -ab 5 -ad 512 -lw 1e-3": "fastest found at this error",
}
SKY_SEARCH = {
    "replicates": (2,), "paths": (32, 48, 64, 96, 128, 192, 256, 384, 512, 1024),
    "cell_size": (0.3, 0.45, 0.6), "cell_sky_rays": (128,),
    "sensor_sky_rays": (1024, 2048, 4096, 8192),
}  # fmt: skip
SKY_BY_CELLS = {
    "solved_cells": (True,), "replicates": (2,), "paths": (128, 192, 224, 256, 320),
    "cell_paths": (4, 8, 16), "cell_size": (0.45, 0.6, 0.7, 0.75, 0.8),
    "cell_sky_rays": (64, 128, 256), "sensor_sky_rays": (1024, 2048, 4096),
}  # fmt: skip
SUN_SEARCH = {
    "replicates": (2,), "paths": (64, 128, 256, 384, 512, 768),
    "cell_size": (0.3, 0.45, 0.6), "cell_sky_rays": (16,), "sensor_sky_rays": (64,),
    "sensor_sun_samples": (1, 4),
}  # fmt: skip
SUNS_BY_CELLS = {
    "solved_cells": (True,), "replicates": (2,), "paths": (64, 128, 256, 320, 384),
    "cell_paths": (8, 16, 24), "cell_size": (0.45, 0.6, 0.7), "cell_sky_rays": (16,),
    "sensor_sky_rays": (64,), "sensor_sun_samples": (1, 4),
}  # fmt: skip
FILM = {
    "-ab 5 -ad 512 -lw 1e-9": "nothing cut off",
    "-ab 5 -ad 512 -lw 1e-3": "less time at nearly this error",
}
FILM_EXACT = "-dt 0 -dc 1 -aa 0 -as 0 -st 0 -ss 0"
"""Neither interpolation nor jitter by the size of the BSDF's cells; see validation."""
FILM_SEARCH = {
    "replicates": (2,), "paths": (16, 32, 64, 96), "cell_size": (0.6, 0.9),
    "cell_sky_rays": (16,), "sensor_sky_rays": (64,), "sensor_sun_samples": (1,),
    "pane_points": (16, 32, 64), "film_sky_samples": (16,),
}  # fmt: skip
FILM_BY_CELLS = {
    **FILM_SEARCH, "solved_cells": (True,), "paths": (16, 32, 64), "cell_paths": (8,),
}  # fmt: skip
QUICK = {"paths": (64, 256, 1024), "cell_size": (0.45,), "sensor_sky_rays": (4096,)}


def table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Print a Markdown table."""
    head = list(head)
    for row in (head, ["---"] * len(head), *rows):
        print("| " + " | ".join(map(str, row)) + " |")
    print(flush=True)


def timed(work: Callable[[], Any]) -> tuple[Any, np.ndarray]:
    """Result of some work, and its wall and processor seconds, children included."""
    wall, cpu = perf_counter(), sum(os.times()[:4])
    out = work()
    return out, np.array([perf_counter() - wall, sum(os.times()[:4]) - cpu])


def seconds(work: Callable[[], object], times: int) -> np.ndarray:
    """Median wall and processor seconds of some runs after a first one that compiles."""
    work()
    return np.median([timed(work)[1] for _ in range(times)], axis=0)


def columns(time: np.ndarray, errors: CoefficientErrors) -> list[str]:
    return [
        *(f"{v:.3g}" for v in time), f"{errors.total:.3f}", f"{errors.direct:.3f}",
        f"{errors.dark:.3f}", f"{errors.mean:.4f}",
    ]  # fmt: skip


HEAD = [
    "",
    "seconds",
    "CPU seconds",
    "RMS",
    "direct part",
    "entries without direct light",
    "mean / reference",
]


def settings(search: dict[str, tuple], quick: bool) -> list[dict[str, float]]:
    search = {**search, **QUICK} if quick else search
    return [
        dict(zip(search, values, strict=True)) for values in itertools.product(*search.values())
    ]


def fastest(
    search: list[dict[str, float]], work: Callable[[dict], tuple[np.ndarray, np.ndarray]],
    known: KnownCoefficients, goals: Sequence[Callable[[CoefficientErrors], bool]],
) -> list[tuple[np.ndarray, dict[str, float], CoefficientErrors] | None]:  # fmt: skip
    """Settings that reach each goal in the least time; times of the finalists are repeated."""
    tried = []
    for accuracy in search:
        work(accuracy)
        (total, direct), taken = timed(partial(work, accuracy))
        tried.append((taken, accuracy, known.errors(total, direct)))
    tried.sort(key=lambda t: t[0][0])
    best = []
    for reached in goals:
        fit = [t for t in tried if reached(t[2])][:4]
        again = [(seconds(partial(work, a), 7), a, e) for _, a, e in fit]
        best.append(min(again, key=lambda t: t[0][0], default=None))
    return best


def compare(
    room: Classroom, search: list[dict[str, float]], suns: Suns, name: str, bins: list[str],
    known: KnownCoefficients, theirs: dict[str, tuple[np.ndarray, CoefficientErrors]],
    rows: list[list[str]],
) -> None:  # fmt: skip
    """Find our fastest settings for each of Radiance's errors, and print all rows."""

    def work(accuracy: dict) -> tuple[np.ndarray, np.ndarray]:
        C = room.ours(suns, **accuracy)
        at = positions(bins, C["bin"].values)
        direct, rest = (C[name].values[:, at] for name in ("direct", "interreflected"))
        return direct + rest.astype(float), direct

    wanted = list(itertools.product(theirs, (False, True)))
    goals = [
        partial(CoefficientErrors.within, other=theirs[line][1], every=every)
        for line, every in wanted
    ]
    choices = fastest(search, work, known, goals)
    for (line, every), best in zip(wanted, choices, strict=True):
        at = "errors" if every else "RMS"
        if best is None:
            rows.append([f"{name}: no setting tried reaches the {at} of `{line}`", *"------"])
            continue
        time, accuracy, errors = best
        wall, cpu = theirs[line][0] / time
        ratio = f"**{wall:.0f} × faster** ({cpu:.0f} × in CPU seconds) at the {at} of `{line}`"
        rows.append([f"{name}, {short(accuracy)}: {ratio}", *columns(time, errors)])
    table(HEAD, rows)


def short(accuracy: dict[str, float]) -> str:
    return ", ".join(f"{k} {v}" for k, v in accuracy.items())


def sky(room: Classroom, options: argparse.Namespace, folder: Path) -> None:
    """Part (a)."""
    print(f"## (a) Sky coefficients, {len(room.sensors[0])} sensors × {BINS} bins\n")
    known = reference(room, None, 16 if options.quick else 256, options.reference)
    traced, theirs, rows = room.room(folder), {}, []
    for line, why in SKY.items():
        arguments = [*PROCESSES, *line.split()]
        direct = traced.sky([*arguments, "-ab", "1"])[0]
        total, time = timed(partial(traced.sky, arguments))
        theirs[line] = time, known.errors(total[0], direct)
        rows.append([f"`rcontrib -n 2 {line}` ({why})", *columns(*theirs[line])])
    search = settings(SKY_SEARCH, options.quick) + settings(SKY_BY_CELLS, options.quick)
    compare(room, search, NO_SUNS, "ours", Patches().labels, known, theirs, rows)


def suns(room: Classroom, options: argparse.Namespace, folder: Path) -> None:
    """Part (b)."""
    count, picked = len(room.year.labels), len(room.suns.labels)
    where = room.weather.stem if room.weather else "the default year"
    print(f"## (b) Exact suns of 0.5°, {len(room.sensors[0])} sensors\n")
    print(f"{where}: {count} suns above the horizon in the EvalDRC calendar.")
    known = reference(room, room.suns, 16 if options.quick else 128, options.reference)
    traced, theirs, rows = room.room(folder), {}, []
    ask = (room.suns.directions, room.suns.diameter)
    for line, why in SUNS.items():
        arguments = [*PROCESSES, *line.split()]
        direct = traced.suns(*ask, [*arguments, "-ab", "0"])[0]
        total, time = timed(partial(traced.suns, *ask, arguments))
        theirs[line] = time * count / picked, known.errors(total[0], direct)
        shown = f"{time[0]:.1f} s for {picked} suns, times {count} / {picked}"
        rows.append([f"`rcontrib -n 2 {line}` ({why}), {shown}", *columns(*theirs[line])])
    search = settings(SUN_SEARCH, options.quick) + settings(SUNS_BY_CELLS, options.quick)
    name = f"ours, all {count} suns and a coarse sky"
    compare(room, search, room.year, name, list(room.suns.labels), known, theirs, rows)


def started(
    command: list[str], environment: dict[str, str], out: Path
) -> tuple[float, float, float] | None:
    """Wall seconds, peak memory [MiB] and disk [MB] of an evaluation; None where it failed."""
    start = perf_counter()
    process = subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    time = perf_counter() - start
    if process.returncode:
        print(f"`{' '.join(command)}` ended with exit code {process.returncode}.\n")
        return None
    memory = usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    disk = sum(f.stat().st_size for f in out.rglob("*") if f.is_file())
    return time, memory / 2**20, disk / 1e6


def evaluation(case: str, out: Path, weather: Path | None) -> list[str]:
    """Command of an evaluation."""
    command = [sys.executable, "-m", "drcmitsuba.cli.main", "evaluate", case, "-o", str(out)]
    return [*command, "--weather", str(weather)] if weather else command


def whole(room: Classroom, options: argparse.Namespace, folder: Path) -> None:
    """Part (c)."""
    print(f"## (c) `drcmitsuba evaluate {CASE}`, both shade states, all files and plots\n")
    cache, out = folder / "kernels", folder / "results"
    cache.mkdir()
    environment = {**os.environ, "DRJIT_CACHE_DIR": str(cache)}
    rows = []
    for name in ("no kernels cached", "kernels cached", "kernels cached, again"):
        took = started(evaluation(CASE, out, room.weather), environment, out)
        if took is None:
            return
        time, memory, disk = took
        kernels = len(list(cache.iterdir()))
        rows.append([name, f"{time:.1f}", f"{memory:.0f}", f"{disk:.1f}", kernels])
    table(["", "seconds", "peak memory [MiB]", "disk [MB]", "kernels in the cache after"], rows)


def scaling(room: Classroom, options: argparse.Namespace, folder: Path) -> None:
    """Part (d)."""
    print("## (d) Denser sensors: sky and 100 suns\n")
    both = {"replicates": 2, "cell_size": 0.45, "cell_sky_rays": 128, "sensor_sky_rays": 4096}
    of_paths = {**both, "paths": 256}
    by_cells = {**both, "solved_cells": True, "paths": 192, "cell_paths": 8}  # with smaller errors
    points, normals = room.sensors
    low, high = points.min(axis=0), points.max(axis=0)
    rows = []
    for nx, ny in ((24, 24), (72, 80), (240, 240)):
        x, y = np.meshgrid(np.linspace(low[0], high[0], nx), np.linspace(low[1], high[1], ny))
        p = np.column_stack([x.ravel(), y.ravel(), np.full(nx * ny, low[2])])
        n = np.tile(normals[0], (nx * ny, 1))
        times = 1 if nx > 100 else 3
        a, b = (
            seconds(partial(room.ours, room.suns, p, n, **accuracy), times)[0]
            for accuracy in (of_paths, by_cells)
        )
        entries = nx * ny * (BINS + len(room.suns.labels))
        rows.append([f"{nx * ny:,}", f"{a:.2f}", f"{b:.2f}", f"{b / entries * 1e6:.2f}"])
    print(f"paths: {short(of_paths)}\n\nsolved cells: {short(by_cells)}\n")
    table(["sensors", "seconds, paths", "solved cells", "µs per sensor and bin"], rows)


def film(plain: Classroom, options: argparse.Namespace, folder: Path) -> None:
    """Part (e)."""
    room = films.Filmed(plain.weather, folder=folder)
    count, picked = len(room.year.labels), len(room.suns.labels)
    print(f"## (e) Exact suns by way of a film, O2, {len(room.sensors[0])} sensors\n")
    print(f"{count} suns of the EvalDRC calendar are in front of the façade.")
    known = films.reference(room, 8 if options.quick else 16)
    traced, theirs, rows = room.room(folder), {}, []
    ask = (room.suns.directions, room.suns.diameter)
    for line, why in FILM.items():
        arguments = [*PROCESSES, *FILM_EXACT.split(), *line.split()]
        direct = traced.suns_by_rtrace(*ask, [*arguments, "-ab", "0"])[0]
        total, time = timed(partial(traced.suns_by_rtrace, *ask, arguments))
        theirs[line] = time * count / picked, known.errors(total[0], direct)
        shown = f"{time[0]:.1f} s for {picked} suns, times {count} / {picked}"
        rows.append([f"`rtrace -n 2 {line}` ({why}), {shown}", *columns(*theirs[line])])
    hundred = films.Filmed(plain.weather, 33 * (picked - 1) + 1, folder).suns
    line = f"-V+ {list(FILM)[-1]}"
    ask, arguments = (hundred.directions, hundred.diameter), [*FILM_EXACT.split(), *line.split()]
    direct = traced.suns(*ask, [*PROCESSES, *arguments, "-ab", "0"])[0, :, ::33]
    total, time = timed(partial(traced.suns, *ask, [*PROCESSES, *arguments]))
    theirs[line] = time * count / len(hundred.labels), known.errors(total[0, :, ::33], direct)
    shown = f"{time[0]:.1f} s for {len(hundred.labels)} suns, errors of the same {picked}"
    rows.append([f"`rcontrib -n 2 {line}`, {shown}", *columns(*theirs[line])])
    search = settings(FILM_SEARCH, options.quick) + settings(FILM_BY_CELLS, options.quick)
    name = f"ours, all {count} suns and a coarse sky"
    compare(room, search, room.year, name, list(room.suns.labels), known, theirs, rows)


PHOTON_MAPS = ((800_000, 50), (800_000, 200), (6_400_000, 50), (6_400_000, 200))
"""Photons of a map and of a look-up."""
PHOTON_SETTINGS = tuple(
    {"replicates": 2, "photons": photons, "paths": paths}
    for photons, paths in ((512, 32), (768, 32), (1024, 32), (1280, 64), (2048, 128), (8192, 512))
)
"""Photons of a sun, and paths of a sensor: with so few photons, more paths gain nothing."""


def component(room: Classroom, options: argparse.Namespace, folder: Path) -> None:
    """Part (f)."""
    print("## (f) Photons by mirror lamellae\n")
    lamellae = photons.Lamellae()
    traced = photons.tracer(lamellae)
    # In turn, so that other work on the machine slows both.
    pairs = [(photons.photon_rate(traced, i), photons.ray_rate(traced, i)) for i in range(6)][1:]
    rate, bare = (np.median(x) for x in zip(*((a[0], b) for a, b in pairs), strict=True))
    share = np.median([a[0] / b for a, b in pairs])
    print(
        f"{rate / 1e6:.1f} M segments of photons a second, {pairs[0][0][1]:.1f} to a photon; bare "
        f"closest hits of the same rays {bare / 1e6:.1f} M a second: {share:.0%}.\n"
    )
    out = folder / "results"
    took = started(evaluation(photons.CASE, out, None), dict(os.environ), out)
    if took is not None:
        with xr.open_dataset(out / "illuminance.nc", engine="h5netcdf") as illuminance:
            errors = photons.year_errors(illuminance)
        time, memory, disk = took
        row = [f"{time:.0f}", *(f"{np.quantile(errors, q):.1%}" for q in (0.5, 0.95))]
        head = [
            "seconds of the year",
            "median error",
            "95th percentile",
            "memory [MiB]",
            "disk [MB]",
        ]
        table(head, [[*row, f"{memory:.0f}", f"{disk:.1f}"]])
    known, own = photons.converged(lamellae)
    print(f"Reference: ours, own RMS {own:.1%}. Errors are RMS, bias included, over the mean.\n")
    ours, rows = [], []
    for accuracy in PHOTON_SETTINGS[:1] if options.quick else PHOTON_SETTINGS:
        settings = {**accuracy, "cell_sky_rays": 1, "sensor_sky_rays": 1, "sensor_square": 0.25}
        C, spent = lamellae.ours(**settings), seconds(partial(lamellae.ours, **settings), 7)
        error = photons.relative_error(C["replicates"].values.mean(axis=0), known)
        ours.append((error, spent[0]))
        rows.append([f"ours, {short(accuracy)}", f"{spent[0]:.2f}", f"{error:.3f}", "", ""])
    traced, suns = lamellae.theirs(folder), lamellae.suns
    for count, bandwidth in PHOTON_MAPS[:1] if options.quick else PHOTON_MAPS:
        ask = partial(traced.photons, suns.directions, suns.diameter)
        estimate = ask(count=count, bandwidth=bandwidth)
        error = photons.relative_error(lamellae.by_field(estimate.coefficients), known)
        # Of the look-ups one in each field is counted: means of many only spare Radiance the blame
        # for telling points where our squares tell fields.
        theirs = estimate.emission + estimate.look_up / lamellae.finer**2
        errors, times = np.log(sorted(ours)).T
        ratio = theirs / np.exp(np.interp(np.log(error), errors, times))
        split = f"{estimate.emission:.2f} + {theirs - estimate.emission:.3f}"
        name = f"`mkpmap -apC` {count:,} + `rcontrib -ap` {bandwidth}"
        rows.append([name, split, f"{error:.3f}", f"{estimate.size / 1e6:.0f}", f"{ratio:.0f} ×"])
    head = ["", "seconds", "RMS", "disk [MB]", "ours is faster at equal error by"]
    table(head, rows)


PARTS = {"a": sky, "b": suns, "c": whole, "d": scaling, "e": film, "f": component}


def main() -> None:
    about = __doc__ or ""
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench", description=about,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--parts", default="a,b,c,d,e,f", help="which parts, default a,b,c,d,e,f")
    parser.add_argument("--reference", type=Path, help="folder that keeps the reference")
    parser.add_argument("--weather", type=Path, help="weather file instead of Geneva's")
    parser.add_argument("--quick", action="store_true", help="coarse reference, small searches")
    options = parser.parse_args()
    parts = options.parts.split(",")
    if unknown := set(parts) - set(PARTS):
        parser.error(f"--parts: {', '.join(sorted(unknown))} is none of {', '.join(PARTS)}")
    if {"a", "b", "e", "f"} & set(parts) and radiance.home() is None:
        parser.error("parts a, b, e and f need Radiance: pip install pyradiance")
    backend.select()
    print(f"# Benchmark, {datetime.date.today().isoformat()}\n\n{machine()}")
    print(f"{radiance.run(['rcontrib', '-version'], Path()).decode()}" if radiance.home() else "")
    room = Classroom(options.weather) if options.weather else Classroom()
    for part in parts:
        with tempfile.TemporaryDirectory() as folder:
            PARTS[part](room, options, Path(folder))


if __name__ == "__main__":
    main()
