"""The command line: `drcmitsuba VERB …`. See `drcmitsuba --help`.

This module puts the commands together and turns errors into one line and an exit code.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping
from typing import Annotated

import typer
from typer.core import TyperCommand

from drcmitsuba.cli import (
    bench,
    cache,
    case,
    comply,
    evaluate,
    export,
    films,
    glare,
    information,
    lights,
    optimise,
    plan,
    render,
    report,
    season,
    steps,
    study,
    tradeoff,
)
from drcmitsuba.cli.near_signs import allow
from drcmitsuba.cli.startup import with_kernels
from drcmitsuba.runtime import interruption
from drcmitsuba.runtime.errors import BackendError, InputError, is_caused_by, on_a_line, was_stopped

WITH_KERNELS: tuple[Callable[..., None], ...] = (
    evaluate.evaluate, comply.comply, plan.plan, case.case, tradeoff.tradeoff, optimise.optimise,
    season.season, steps.sky, steps.coefficients, steps.illuminance, steps.metrics, steps.plot,
    export.export, report.report, lights.lights, render.render, glare.glare,
    study.study, films.bsdf, films.goniophotometer, information.doctor, bench.bench,
)  # fmt: skip
WITHOUT_KERNELS: tuple[Callable[..., None], ...] = (
    information.new,
    information.schema,
    cache.cache,
)


class _Verb(TyperCommand):
    """Command whose help leaves out Python's types, which the names of the values imply."""

    def get_help(self, ctx: typer.Context) -> str:  # type: ignore[override]
        return re.sub(r" <[^<>\n]+>", lambda match: " " * len(match[0]), super().get_help(ctx))


VERBS: dict[str, Callable[..., None]] = {
    **{command.__name__: command for command in WITHOUT_KERNELS},
    **{command.__name__: with_kernels(command) for command in WITH_KERNELS},
}


def _print_version(asked: bool) -> None:
    if asked:
        from drcmitsuba import __version__

        print(f"drcmitsuba {__version__}")
        raise typer.Exit


def _root(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_print_version, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        print(context.get_help())


def app_of(verbs: Mapping[str, Callable[..., None]] = VERBS) -> typer.Typer:
    """Command line of some verbs, by default of all."""
    app = typer.Typer(
        name="drcmitsuba",
        help="Annual daylight simulation of daylight redirecting components.",
        epilog=(
            "drcmitsuba new writes a case to start from; drcmitsuba VERB --help explains a verb."
        ),
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,  # square brackets in help texts are units and tables, no markup
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback(invoke_without_command=True)(_root)
    for name, command in verbs.items():
        app.command(name=name, cls=_Verb)(command)
    return app


def _asked() -> Mapping[str, Callable[..., None]]:
    """The verb that is asked for, since the options of all take time to build; else all verbs."""
    name = "".join(sys.argv[1:2])
    return {name: VERBS[name]} if name in VERBS else VERBS


def main() -> None:
    """Run the command line and turn errors into one line and an exit code."""
    allow(sys.stdout, sys.stderr)
    try:
        code = app_of(_asked())(standalone_mode=False)
        if code == interruption.STOPPED:  # Typer has caught KeyboardInterrupt
            raise KeyboardInterrupt
        sys.stdout.flush()
    except (typer.Abort, KeyboardInterrupt):
        _exit(interruption.LINE, interruption.STOPPED)
    except (InputError, BackendError) as error:
        _exit(f"drcmitsuba: {error}\n", 2 if isinstance(error, InputError) else 1)
    except SystemExit as stop:
        if not is_caused_by(stop, BrokenPipeError):  # nobody reads stdout, which rich makes an exit
            raise
    except Exception as error:
        if was_stopped(error):
            _exit(interruption.LINE, interruption.STOPPED)
        if hasattr(error, "format_message"):  # a usage error of click
            message = on_a_line(error.format_message().rstrip("."))
            _exit(f"drcmitsuba: command line: {message}; see drcmitsuba --help\n", 2)
        if isinstance(error, BrokenPipeError):  # the files are written; nobody reads stdout
            return
        if isinstance(error, OSError):
            remedy = "check the path, its rights and the space that is left"
            got = str(error.strerror or error)
            line = InputError(error.filename or "files", "file", got, remedy)
            _exit(f"drcmitsuba: {line}\n", 2)
        if interruption.came:
            _exit(interruption.LINE, interruption.STOPPED)
        raise


def _exit(line: str, code: int) -> None:
    sys.stderr.write(line)
    sys.exit(code)


if __name__ == "__main__":
    main()
