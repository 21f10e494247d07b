"""The bench: least seconds in which ours has no larger error than Radiance, and its table."""

from __future__ import annotations

import datetime
import math
import os
import platform
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from time import perf_counter
from typing import Any, Literal

import numpy as np

from drcmitsuba.annual.bench.radiance import (
    SKY_OPTIONS,
    SUN_OPTIONS,
    RadianceRoom,
    other_programs,
)
from drcmitsuba.annual.bench.reference import (
    CoefficientErrors,
    KnownCoefficients,
    known,
    trace_halves,
)
from drcmitsuba.annual.bench.room import BINS, NO_SUNS, BenchRoom
from drcmitsuba.export.programs import INSTALL, RadiancePrograms
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.sky.sun_models import Suns

HEAD = "| program | seconds | rays | RMS | direct part | without direct light | ratio |"
STEPS = tuple(2 ** (i / 2) for i in range(-4, 7))
"""Factors of the samples of SKY and SUNS that are tried, least first."""
SKY: dict[str, Any] = {
    "paths": 224, "cell_paths": 8, "cell_size": 0.7, "cell_sky_rays": 128, "sensor_sky_rays": 2048,
}  # fmt: skip
SUNS: dict[str, Any] = {
    "paths": 320, "cell_paths": 16, "cell_size": 0.6, "cell_sky_rays": 16, "sensor_sky_rays": 64,
    "sensor_sun_samples": 4,
}  # fmt: skip
"""Samples of the settings that were found the fastest at Radiance's error in a search of many."""
TIMES = 5
"""Number of runs of ours, of whose seconds the median is taken, after one that compiles."""


@dataclass(frozen=True)
class Scope:
    """How much the bench simulates.

    Parameters
    ----------
    every : int
        Only every so many-th sensor along each axis.
    picked : int
        Number of suns that Radiance traces, and that errors are measured on.
    rounds : int
        Number of rounds of the reference of the sky; that of the suns has half of them.
    """

    every: int = 1
    picked: int = 50
    rounds: int = 32


WHOLE = Scope()
QUICK = Scope(every=2, picked=20, rounds=8)


@dataclass(frozen=True)
class Timed:
    """Seconds, rays where they are known, and errors of one program."""

    name: str
    seconds: float
    """Seconds of the work [s]; NaN where no setting that was tried has errors so small."""
    errors: CoefficientErrors
    rays: int | None = None
    ratio: float | None = None
    """Seconds of Radiance over these."""

    def row(self) -> str:
        """Row of the table in Markdown."""
        e = self.errors
        rays = "–" if self.rays is None else f"{self.rays / 1e6:.2f} M"
        ratio = "–" if self.ratio is None else f"**{self.ratio:.0f} ×**"
        numbers = (f"{v:.3f}" for v in (e.total, e.direct, e.dark))
        s = self.seconds
        seconds = "–" if math.isnan(s) else f"{s:,.0f}" if s >= 100 else f"{s:.3g}"
        return f"| {self.name} | {seconds} | {rays} | {' | '.join(numbers)} | {ratio} |"


@dataclass(frozen=True)
class Bench:
    """Result of a bench: tables by the kind of source, and what they were measured on.

    Parameters
    ----------
    parts : dict
        Heading of a table → its rows and the sentence on its reference.
    notes : tuple of str
        Sentences below the tables.
    """

    parts: dict[str, tuple[tuple[Timed, ...], str]]
    notes: tuple[str, ...]

    def markdown(self) -> str:
        """Tables that can be pasted."""
        lines = [f"### drcmitsuba bench, {datetime.date.today().isoformat()}", "", machine()]
        for heading, (rows, about) in self.parts.items():
            lines += ["", f"**{heading}**", "", HEAD, "|" + "---|" * HEAD.count(" | ") + "---|"]
            lines += [*(row.row() for row in rows), "", about]
        return "\n".join([*lines, "", *self.notes]) + "\n"


def machine() -> str:
    """Processor, cores, load, and versions on which the numbers depend."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.is_file() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    versions = [f"{name} {metadata.version(name)}" for name in ("drcmitsuba", "mitsuba", "drjit")]
    llvm = ".".join(map(str, backend.llvm_version() or ("none",)))
    return (
        f"{names[0] if names else platform.processor() or platform.machine()}, {os.cpu_count()} "
        f"cores{load}; {platform.system()}; {backend.select()}, LLVM {llvm}; {', '.join(versions)}."
    )


def bench(scope: Scope = WHOLE, weather: Path | None = None, stage: Stage = silent) -> Bench:
    """Measure this program, and Radiance where it is found, on sky and suns of the classroom.

    Parameters
    ----------
    scope : Scope
        WHOLE takes some minutes on two cores, QUICK about one.
    weather : Path, optional
        Weather file of the suns; by default the package's own year.
    stage : callable, optional
        Shows the stages of the work.

    Returns
    -------
    Bench

    Raises
    ------
    InputError
        A program of Radiance fails, or the weather file is unfit.
    BackendError
        No fit LLVM or GPU.
    """
    backend.select()
    room = BenchRoom(weather, scope.picked, scope.every)
    programs = RadiancePrograms.found()
    parts, processes = {}, os.cpu_count() or 1
    with tempfile.TemporaryDirectory() as folder:
        theirs = None
        if programs is not None:
            theirs = RadianceRoom.of(programs, room.case, Path(folder) / "room", processes)
        for one in (_sky(theirs), _suns(theirs, len(room.year.labels), scope.picked)):
            reference, rows = _measured(room, one, scope, stage)
            sensors = len(room.sensors[0])
            about = f"Reference: unbiased paths, own RMS {reference.own_error:.1%}"
            heading = f"{one.title.format(suns=len(room.year.labels))}, {sensors} sensors"
            parts[heading] = rows, f"{about}; {reference.agreement}."
    return Bench(parts, tuple(_notes(programs, processes)))


@dataclass(frozen=True)
class Kind:
    """One kind of source: what is asked of each program."""

    light: Literal["sky", "suns"]
    title: str
    samples: dict[str, Any]
    line: str
    """Command of Radiance, shortened."""
    trace: Callable[[str, Suns], tuple[np.ndarray, float]] | None
    """Coefficients of Radiance by options, and its seconds; None without Radiance."""
    options: str
    only_direct: str
    times: float = 1.0
    """Suns of the year over those that Radiance traces."""

    @property
    def is_sky(self) -> bool:
        """Whether the sky lights the room, not suns."""
        return self.light == "sky"


def _sky(theirs: RadianceRoom | None) -> Kind:
    trace = None if theirs is None else lambda options, _: theirs.sky(options)
    line = f"`rcontrib {SKY_OPTIONS}`"
    title = f"{BINS} bins of sky and ground"
    return Kind("sky", title, SKY, line, trace, SKY_OPTIONS, "-ab 1")


def _suns(theirs: RadianceRoom | None, count: int, picked: int) -> Kind:
    trace = None if theirs is None else lambda options, suns: theirs.suns(suns, options)
    line = f"`rcontrib {SUN_OPTIONS}`, {picked} suns, times {count} / {picked}"
    title = "Exact suns of a year, {suns}, all bounces"
    return Kind("suns", title, SUNS, line, trace, SUN_OPTIONS, "-ab 0", count / picked)


def _measured(
    room: BenchRoom, kind: Kind, scope: Scope, stage: Stage
) -> tuple[KnownCoefficients, tuple[Timed, ...]]:
    """Reference, and a row for Radiance and for ours at each of its errors."""
    rounds = scope.rounds if kind.is_sky else scope.rounds // 2
    with stage(f"{kind.light}: reference") as done:
        reference = known(*trace_halves(room, None if kind.is_sky else room.suns, rounds, done))
    rows: list[Timed] = []
    if kind.trace is not None:
        with stage(f"{kind.light}: Radiance") as done:
            direct, _ = kind.trace(f"{kind.options} {kind.only_direct}", room.suns)
            done(0.2)
            total, seconds = kind.trace(kind.options, room.suns)
            errors = reference.errors(total, direct)
            rows = [Timed(kind.line, seconds * kind.times, errors)]
    goal = rows[0] if rows else None
    with stage(f"{kind.light}: ours") as done:
        return reference, (*rows, *_ours(room, kind, reference, goal, done))


def _ours(
    room: BenchRoom, kind: Kind, reference: KnownCoefficients, goal: Timed | None,
    progress: Callable[[float], None],
) -> Iterator[Timed]:  # fmt: skip
    """Rows of the fewest samples with no larger error in any column, and over all entries."""
    if goal is None:
        yield _timed(room, kind, reference, 1.0)
        return
    tried = []
    for i, step in enumerate(STEPS):
        tried.append(_timed(room, kind, reference, step))
        progress((i + 1) / len(STEPS))
    for every, words in ((True, "no column worse"), (False, "at its RMS")):
        fit = [t for t in tried if t.errors.within(goal.errors, every)]
        if not fit:
            yield Timed(f"ours, {words}: no setting tried", math.nan, tried[-1].errors)
            continue
        best = min(fit, key=lambda t: t.seconds)
        ratio = goal.seconds / best.seconds
        yield Timed(f"ours, {words}", best.seconds, best.errors, best.rays, ratio)


def _timed(room: BenchRoom, kind: Kind, reference: KnownCoefficients, step: float) -> Timed:
    """Seconds and errors of ours with a factor of the samples."""
    whole = {k: v * step if k != "cell_size" else v for k, v in kind.samples.items()}
    accuracy = {k: v if k == "cell_size" else max(1, round(v)) for k, v in whole.items()}
    suns = NO_SUNS if kind.is_sky else room.year

    def work() -> Any:
        return room.ours(suns, solved_cells=True, replicates=2, **accuracy)

    before = room.scene_with_cells.ray_counter.counted()
    C = work()  # compiles what is not compiled yet
    after = room.scene_with_cells.ray_counter.counted()
    seconds = []
    for _ in range(TIMES):
        start = perf_counter()
        work()
        seconds.append(perf_counter() - start)
    bins = slice(0, BINS) if kind.is_sky else list(room.suns.labels)
    C = C.isel(bin=bins) if kind.is_sky else C.sel(bin=bins)
    direct = C["direct"].values.astype(float)
    errors = reference.errors(direct + C["interreflected"].values, direct)
    rays = sum(after.values()) - sum(before.values())
    return Timed("ours", float(np.median(seconds)), errors, rays)


def _notes(programs: RadiancePrograms | None, processes: int) -> Iterator[str]:
    """Sentences below the tables."""
    yield (
        "RMS errors, the reference's own included, are over all entries (sensor, bin) of the "
        "coefficients, relative to their mean; those without direct light relative to their own. "
        "Kernels are warm, the import is not counted; `oconv` is."
    )
    if programs is None:
        yield f"Radiance was not found: {INSTALL}, and run `drcmitsuba bench` again."
    else:
        yield f"{programs.version()}, {programs.where}, {processes} processes."
    if others := other_programs():
        yield f"Also found, not run: {', '.join(others)}."
