"""The command line: `drcmitsuba VERB …`. See `drcmitsuba --help`."""

from __future__ import annotations

import json
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli import films, optimise, plan, tradeoff
from drcmitsuba.cli.terminal import Output, stages, writable
from drcmitsuba.runtime.errors import BackendError, InputError, on_a_line, was_stopped

if TYPE_CHECKING:
    from drcmitsuba.annual.result import Result

app = typer.Typer(
    name="drcmitsuba",
    help="Annual daylight simulation of daylight redirecting components.",
    add_completion=False,
    pretty_exceptions_enable=False,
)

STOPPED = 130
"""Exit code after Ctrl-C."""

CasePath = Annotated[str, typer.Argument(help="Case file (TOML), or a shipped case by name.")]
Weather = Annotated[
    Path | None, typer.Option("--weather", help="Weather file in place of the case's own.")
]


def _percent(value: dict[str, float] | None) -> str:
    if value is None:
        return "–"
    return f"{value['value']:.1f} ({value['low']:.1f} … {value['high']:.1f})"


def _print_metrics(numbers: dict, title: str) -> None:
    console = Console()
    annual = Table(title=escape(title), title_justify="left")
    annual.add_column("year")
    annual.add_column("% (95 % interval)", justify="right")
    for name, label in (("sDA", "sDA"), ("ASE", "ASE"), ("shade_closed", "shade closed")):
        annual.add_row(label, _percent(numbers[name]))
    console.print(annual)
    months = Table("month", "msDA %", "MSE %", "shade closed %")
    rows = zip(numbers["msDA"], numbers["MSE"], numbers["shade_closed_monthly"], strict=True)
    for month, row in enumerate(rows, start=1):
        months.add_row(str(month), *(_percent(value) for value in row))
    console.print(months)


def _print_accuracy(accuracy: dict) -> None:
    told = f"rounds: {accuracy['rounds']}, ±{accuracy['half_width']:.2g}"
    print(f"{accuracy['reason']}: {told}, wanted ±{accuracy['target']}")


def _print_undecided(undecided: list[dict]) -> None:
    count = Counter(u["metric"] for u in undecided)
    if undecided:
        told = ", ".join(f"{count[name]} of {name}" for name in ("sDA", "ASE"))
        print(f"points too close to call: {told} (metrics.json, undecided)")


@app.command()
def evaluate(
    case: CasePath,
    output: Output = Path("results"),
    weather: Weather = None,
    coefficients: Annotated[
        Path | None,
        typer.Option(help="coefficients.zarr of this case, computed for another weather."),
    ] = None,
    variants: Annotated[
        str | None,
        typer.Option(help="Other façades: cases beside this one, as o1,o2; a folder for each."),
    ] = None,
) -> None:
    """Evaluate a year: illuminance, sDA, ASE, msDA, MSE, plots."""
    if variants is not None:
        if coefficients is not None:
            remedy = "give one of them"
            raise InputError("command line", "--coefficients", "beside --variants", remedy)
        _evaluate_variants(case, variants.split(","), output, weather)
        return
    from drcmitsuba import evaluate as run
    from drcmitsuba import load_case
    from drcmitsuba.runtime import storage

    loaded = load_case(case).with_weather(weather)
    known = None
    if coefficients is not None:
        known = storage.open_dataset(coefficients, "replicates", "straight", "state")
        known = storage.loaded(coefficients, known)
    with stages() as stage:
        result = run(loaded, stage, known)
        result.save(output, stage)
    _print_result(result, output)


def _print_result(result: Result, output: Path) -> None:
    _print_metrics(result.metrics, result.case.name)
    if "accuracy" in result.metrics:
        _print_accuracy(result.metrics["accuracy"])
    _print_undecided(result.metrics["undecided"])
    for note in result.metrics["settings"]["notes"]:
        print(f"note: {note}")
    print(f"results are in {output}")


def _evaluate_variants(case: str, names: list[str], output: Path, weather: Path | None) -> None:
    """Evaluate façades of one room by one simulation."""
    from drcmitsuba.annual.variants import evaluate_variants, load_variants

    cases = [c.with_weather(weather) for c in load_variants(case, names)]
    results = []
    with stages() as stage:
        found = evaluate_variants(cases, stage)
        for name, result in zip([Path(case).stem, *names], found, strict=True):
            result.save(output / name, stage)
            results.append((name, result.metrics))
    table = Table("façade", *(f"{n} % (95 %)" for n in ("sDA", "ASE", "shade closed")))
    for name, numbers in results:
        table.add_row(escape(name), *(_percent(numbers[n]) for n in ("sDA", "ASE", "shade_closed")))
    Console().print(table)
    for note in dict.fromkeys(n for _, r in results for n in r["settings"]["notes"]):
        print(f"note: {note}")
    print(f"results are in the folders of {output}")


@app.command()
def season(case: CasePath, output: Output = Path("season"), weather: Weather = None) -> None:
    """Judge months with the season taken out: beside clear glazing and an open window."""
    from drcmitsuba import load_case
    from drcmitsuba.annual.season import season as compare

    with stages() as stage:
        found = compare(load_case(case).with_weather(weather), stage)
        with stage("writing"):
            found.save(output)
    table = Table("month", "msDA %", "clear glazing %", "opening %", "of the opening %")
    rows = zip(found.design, found.clear, found.opening, found.relative, strict=True)
    for month, (*shares, relative) in enumerate(rows, start=1):
        share = "–" if relative is None else f"{relative:.0f}"
        table.add_row(str(month), *map(_percent, shares), share)
    Console().print(table)
    print(f"results are in {output}")


@app.command()
def sky(case: CasePath, output: Output = Path("results"), weather: Weather = None) -> None:
    """Compute the luminances L of sky and suns: sky.zarr."""
    from drcmitsuba import load_case
    from drcmitsuba.sky import daylight

    loaded = load_case(case).with_weather(weather)
    with stages() as stage, stage("sky"):
        found = daylight.daylight(loaded)
        daylight.save_luminances(found, output / "sky.zarr")
    print(f"{found.sky.sizes['time']} time stamps are in {output / 'sky.zarr'}")


@app.command()
def coefficients(case: CasePath, output: Output = Path("results"), weather: Weather = None) -> None:
    """Compute the coefficients C of both states of the shade: coefficients.zarr.

    Of every sun above the horizon, whether it shines in this weather or not.
    """
    from drcmitsuba import load_case
    from drcmitsuba.annual import simulation
    from drcmitsuba.annual.run import Run
    from drcmitsuba.plan import plan
    from drcmitsuba.runtime import backend, storage
    from drcmitsuba.sky import daylight

    loaded = load_case(case).with_weather(weather).with_dark_hours()
    backend.select()
    with stages() as stage:
        with stage("sky"):
            found = daylight.daylight(loaded)
        run = Run.of(loaded, plan(loaded, found).scope)
        C = simulation.coefficients(loaded, found, replace(run, stage=stage))
        with stage("writing"):
            storage.save_zarr(C.parts(), output / "coefficients.zarr", along="state")
    path, sizes = output / "coefficients.zarr", C.open.sizes
    print(f"{sizes['sensor']} sensors × {sizes['bin']} bins are in {path}")


@app.command()
def illuminance(
    c: Annotated[Path, typer.Argument(help="coefficients.zarr")],
    l: Annotated[Path, typer.Argument(help="sky.zarr")],  # noqa: E741
    output: Output = Path("results"),
) -> None:
    """Multiply C and L to the illuminance E: illuminance.nc."""
    from drcmitsuba.metrics.coefficients_by_state import Coefficients
    from drcmitsuba.metrics.illuminance import illuminance as accumulated
    from drcmitsuba.runtime import storage
    from drcmitsuba.sky import daylight

    C = storage.open_dataset(c, "replicates", "straight", "straight_se", "state", "bin", *"xyz")
    L = storage.open_dataset(l, "L", "bin", "sun", "sun_bin", "clock")
    with stages() as stage, stage("accumulation"):
        L = storage.loaded(l, L.isel(channel=0) if "channel" in L.dims else L)
        states = Coefficients.of(storage.loaded(c, C))
        E = accumulated(states, daylight.from_luminances(L))
        E.attrs["step_hours"] = L.attrs.get("step_hours", 1.0)
        storage.save_netcdf(E, output / "illuminance.nc")
    print(f"{E.sizes['time']} time stamps × {E.sizes['sensor']} sensors are in {output}")


@app.command()
def metrics(
    e: Annotated[Path, typer.Argument(help="illuminance.nc")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", callback=writable, help="Folder for metrics.json."),
    ] = None,
    sda_threshold: Annotated[float | None, typer.Option(help="sDA [lx].")] = None,
    sda_fraction: Annotated[float | None, typer.Option(help="sDA, fraction of the hours.")] = None,
    ase_threshold: Annotated[float | None, typer.Option(help="ASE [lx].")] = None,
    ase_hours: Annotated[float | None, typer.Option(help="ASE [h].")] = None,
) -> None:
    """Compute sDA, ASE, msDA, MSE and shade hours of an illuminance file.

    The thresholds are those of the file's case unless options name others.
    Its intervals are wider than those of evaluate: the file tells the error of every
    illuminance, but not what these errors have in common.
    """
    from drcmitsuba.metrics import evaluate_metrics
    from drcmitsuba.runtime import storage

    thresholds = {
        "sda_threshold": sda_threshold,
        "sda_fraction": sda_fraction,
        "ase_threshold": ase_threshold,
        "ase_hours": ase_hours,
    }
    E = storage.open_dataset(e, "total", "total_se", "direct_sun", "direct_sun_se")
    E = storage.loaded(e, E)
    rules = evaluate_metrics.rules_of(E.attrs, e, thresholds)
    numbers = evaluate_metrics.summarise(E, rules)
    if settings := evaluate_metrics.settings_of(E.attrs, e, rules.metrics):
        numbers["settings"] = settings
    _print_metrics(numbers, str(e))
    t = rules.metrics
    print(
        f"thresholds: sDA {t.sda_threshold:g} lx in {100 * t.sda_fraction:g} % of the hours, "
        f"ASE {t.ase_threshold:g} lx in {t.ase_hours:g} h"
    )
    if output is not None:
        storage.save_json(numbers, output / "metrics.json")


@app.command()
def plot(folder: Annotated[Path, typer.Argument(help="Folder of an evaluation.")]) -> None:
    """Draw the plots of an evaluation again."""
    from drcmitsuba.case.case import Case
    from drcmitsuba.case.toml import checked
    from drcmitsuba.report import figures, plots
    from drcmitsuba.runtime import storage

    path, file = folder / "illuminance.nc", folder / "metrics.json"
    E = storage.loaded(path, storage.open_dataset(path, "total", "direct_sun"))
    numbers = figures.read_numbers(file, E.sizes["sensor"])
    known = {k: v for k, v in numbers["settings"].items() if k in Case.model_fields}
    case = checked(Case, known, file)
    for name, figure in figures.pictures(case, E, numbers).items():
        print(plots.save(figure, folder / name))


app.command(name="bsdf")(films.bsdf)
app.command(name="goniophotometer")(films.goniophotometer)
app.command(name="plan")(plan.plan)
app.command(name="tradeoff")(tradeoff.tradeoff)
app.command(name="optimise")(optimise.optimise)


@app.command()
def schema() -> None:
    """Print the JSON schema of the case file."""
    from drcmitsuba.case.case import Case

    print(json.dumps(Case.model_json_schema(), indent=2))


@app.command()
def doctor() -> None:
    """Report the backend, LLVM, GPU and versions, and whether the program can run here."""
    from drcmitsuba.runtime import backend

    table = Table(show_header=False)
    for name, value in backend.report().items():
        table.add_row(name, value)
    Console().print(table)
    print(f"ready: {backend.select()}")


def main() -> None:
    """Run the command line and turn errors into one line and an exit code."""
    try:
        code = app(standalone_mode=False)
        if code == STOPPED:  # Typer has caught KeyboardInterrupt
            raise KeyboardInterrupt
    except (typer.Abort, KeyboardInterrupt):
        _exit("stopped", STOPPED)
    except InputError as error:
        _exit(str(error), 2)
    except BackendError as error:
        _exit(str(error), 1)
    except Exception as error:
        if was_stopped(error):
            _exit("stopped", STOPPED)
        if hasattr(error, "format_message"):  # a usage error of click
            message = on_a_line(error.format_message().rstrip("."))
            _exit(f"command line: {message}; see drcmitsuba --help", 2)
        if isinstance(error, OSError):
            remedy = "check the path, its rights and the space that is left"
            told = str(error.strerror or error)
            _exit(str(InputError(error.filename or "files", "file", told, remedy)), 2)
        raise


def _exit(line: str, code: int) -> None:
    print(f"drcmitsuba: {line}", file=sys.stderr)
    sys.exit(code)


if __name__ == "__main__":
    main()
