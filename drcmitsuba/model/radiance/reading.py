"""Scene files with the files and commands that they call for."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drcmitsuba.model.radiance import bodies, compiled
from drcmitsuba.model.radiance import command as commands
from drcmitsuba.model.radiance.context import DEEPEST, Context
from drcmitsuba.model.radiance.definitions import MODIFIERS, SURFACES
from drcmitsuba.model.radiance.generators import GENERATORS
from drcmitsuba.model.radiance.patterns import SMOOTHED
from drcmitsuba.model.radiance.polygons import LARGEST
from drcmitsuba.model.radiance.surfaces import SurfacesByModifier
from drcmitsuba.model.radiance.text import (
    Command,
    FileLine,
    Primitive,
    read_bytes,
    sought,
    statements,
)
from drcmitsuba.model.radiance.xform import reversed_front, transform

FACETS = f"Curved bodies are facets, {bodies.AROUND} around, and up to 0.4 % smaller in area"
NO_SOURCES = "Suns, skies and grounds of the source files are left out: the weather file gives them"


Stage = Callable[[Context], None]
"""Command of a pipe: it adds what it gives to a context."""


def read_file(path: Path, context: Context, place: FileLine | None = None) -> None:
    """Add what a file describes to a context.

    Raises
    ------
    InputError
        The file or one that it calls for cannot be read or understood, calls for itself, or asks
        for too much.
    """
    chain = (*context.files, path)
    real = Path(os.path.realpath(path))  # Path.resolve raises where links form a circle
    if real in context.real and place:
        names = " → ".join(file.name for file in chain)
        raise place.error("file", f"a circle: {names}", "take out one of these calls")
    if len(chain) > DEEPEST and place:
        raise place.error("file", f"{len(chain)} files deep", f"nest at most {DEEPEST}")
    context.budget.spend_file(place or FileLine(path, 1))
    text = read_bytes(path, context.budget.bytes)
    context.budget.bytes -= len(text)
    inner = replace(context, files=chain, real=(*context.real, real))
    for statement in statements(text, path):
        if isinstance(statement, Command):
            _run(statement, inner)
        else:
            add(statement, inner)


def add(primitive: Primitive, context: Context) -> None:
    """Add a primitive to a context."""
    if primitive.kind in MODIFIERS or primitive.kind == "alias":
        context.definitions.add(primitive, context.folders)
    elif primitive.kind in ("mesh", "instance"):
        _compiled(primitive, context)
    elif primitive.kind == "source":
        context.notes.add(NO_SOURCES)
    elif primitive.kind in SURFACES:
        name = primitive.modifier if context.override is None else context.override
        definition = context.definitions.of(name, primitive)
        if primitive.kind != "polygon":
            context.notes.add(FACETS)
        count = context.surfaces.add(primitive, definition)
        context.budget.spend_quads(count, primitive.place)
    else:
        raise primitive.error("no kind of primitive of Radiance", "correct the word")


def _compiled(primitive: Primitive, context: Context) -> None:
    """Add a compiled mesh or an octree by the files that it was made from."""
    override = () if primitive.modifier == "void" else ("-m", primitive.modifier)

    def mesh(inner: Context) -> None:
        compiled.add_mesh(primitive, inner)

    def octree(inner: Context) -> None:
        for source in compiled.octree_sources(primitive, inner):
            if source.startswith("!"):
                _run(Command(source[1:], primitive.place), inner)
            else:
                _files([source], primitive.place)(inner)

    known = context.definitions.state()
    stage = mesh if primitive.kind == "mesh" else octree
    _xform([*override, *primitive.strings[1:]], stage, primitive.place)(context)
    context.definitions.restore(known)  # an octree's own names do not serve outside


def _run(command: Command, context: Context) -> None:
    """Add what a command gives to a context."""
    stage: Stage | None = None
    for name, *words in commands.pipeline(command):
        if name in GENERATORS:
            stage = _generator(name, words, command.place)
        elif name == "cat":
            stage = _files(words, command.place) if words else stage
        else:
            stage = _xform(words, stage, command.place)
        if stage is None:
            raise command.place.error("cat", "no file", "name one")
    if stage is not None:
        stage(context)


def _generator(name: str, words: Sequence[str], place: FileLine) -> Stage:
    def stage(context: Context) -> None:
        if name in ("gensurf", "genrev") and "-s" in words[7 if name == "gensurf" else 5 :]:
            context.notes.add(SMOOTHED)
        for primitive in GENERATORS[name](words, place):
            add(primitive, context)

    return stage


def _files(names: Iterable[str], place: FileLine) -> Stage:
    def stage(context: Context) -> None:
        for name in names:
            path = sought(name, context.folders)
            if path is None:
                got = f"no file {name!r}"
                raise place.error("file", got, "put it beside the file that calls for it")
            read_file(path, context, place)

    return stage


def _xform(words: Sequence[str], before: Stage | None, place: FileLine) -> Stage:
    """Stage of `xform`, whose input is its files or the stage before."""

    def stage(context: Context) -> None:
        for line in _with_argument_files(words, context, place, 0):
            _transformed(line, before, context, place)

    return stage


def _with_argument_files(
    words: Sequence[str], context: Context, place: FileLine, depth: int
) -> list[list[str]]:
    """Command lines with each -f and its file replaced by the lines of the file, one at a time."""
    if "-f" not in words:
        return [list(words)]
    at = list(words).index("-f")
    name = words[at + 1] if at + 1 < len(words) else ""
    path = sought(name, context.folders) if name else None
    if path is None or depth >= DEEPEST:
        got = f"-f {name}, " + ("no such file" if path is None else f"{depth} files deep")
        raise place.error("xform", got, "give a file of arguments")
    text = read_bytes(path, context.budget.bytes)
    context.budget.bytes -= len(text)
    lines: list[list[str]] = []
    for number, line in enumerate(text.decode("utf-8", "replace").splitlines(), 1):
        inner = Command("xform " + line.strip().removeprefix("!").removeprefix("xform"), place)
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        context.budget.spend_file(FileLine(path, number))
        given = commands.pipeline(inner._replace(place=FileLine(path, number)))[0][1:]
        whole = [*words[:at], *given, *words[at + 2 :]]
        lines += _with_argument_files(whole, context, place, depth + 1)
    return lines


def _transformed(
    words: Sequence[str], before: Stage | None, context: Context, place: FileLine
) -> None:
    """Add what `xform` gives for its arguments to a context."""
    override, inverted, at = context.override, False, 0
    while at < len(words) and words[at] in ("-n", "-m", "-I", "-c", "-e"):
        option = words[at]
        if option in ("-n", "-m"):
            if at + 1 >= len(words):
                raise place.error("xform", f"{option} without a name", "give one")
            if option == "-m" and context.override is None:
                override = words[at + 1]
            at += 1
        inverted ^= option == "-I"
        at += 1
    moves, used = transform(words[at:], place)
    names = words[at + used :]
    if wrong := [name for name in names if name.startswith("-")]:
        got = f"{wrong[0]} behind {' '.join(words[: at + used]) or 'nothing'}"
        raise place.error("xform", got, "write -n -m -I first, then the moves, then the files")
    stage = _files(names, place) if names else before
    if stage is None:
        raise place.error("xform", "no file", "name one, or write it behind a pipe")
    since = len(context.definitions.order)
    inner = replace(context, surfaces=SurfacesByModifier(context.notes), override=override)
    stage(inner)
    patches = inner.surfaces.patches()
    context.budget.spend_copies(len(moves), place)
    more = len(moves) - 1
    context.budget.spend_quads(more * sum(len(p.quads) for p in patches.values()), place)
    if any(not _in_bounds(moves.matrix, patch.quads) for patch in patches.values()):
        raise place.error("xform", "coordinates that are not finite or too large", "move less")
    if inverted:
        patches = {d: p._replace(quads=reversed_front(p.quads)) for d, p in patches.items()}
    context.surfaces.add_copies(patches, moves, since, place)
    context.definitions.move(moves.one(-1), since)


def _in_bounds(matrix: np.ndarray, quads: np.ndarray) -> bool:
    """Whether moved quads keep to finite coordinates of use."""
    with np.errstate(all="ignore"):
        far = float(np.abs(quads).max(initial=0))
        reach = np.abs(matrix[:, :3, :3]).sum(axis=2) * far + np.abs(matrix[:, :3, 3])
    return bool((reach <= LARGEST).all())
