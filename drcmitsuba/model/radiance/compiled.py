"""Compiled meshes and octrees, by the files that they were made from.

An octree (`oconv`) begins with a text header, an empty line, two bytes, four texts (corner and size
of its cube), and then the names of its scene files; an empty text ends them. Each text ends with a
zero byte. A frozen octree has no names. Compiled meshes (`obj2mesh`) are not read: the OBJ file of
the same stem is, where it lies beside.
"""

from __future__ import annotations

import re
from pathlib import Path, PurePath

from drcmitsuba.model.mesh.obj import read_obj
from drcmitsuba.model.radiance.context import Context
from drcmitsuba.model.radiance.text import Primitive, decoded, sought
from drcmitsuba.model.source_file import size_of

MOST_HEAD = 1 << 20
"""Largest size of an octree's header and names [B]."""
OCTREE = b"\nFORMAT=Radiance_octree\n"
SOURCES = "put !xform and the .rad files that it was made from"
OBJ = "give the OBJ file that it was made from beside it"
MESHES = "Compiled meshes are read from the OBJ files beside them"


def octree_sources(primitive: Primitive, context: Context) -> list[str]:
    """Files and commands (with their !) of an instance's octree.

    Raises
    ------
    InputError
        The octree is missing, frozen, or no octree.
    """
    name = " ".join(primitive.strings[:1]) or "no file"
    path = sought(name, context.folders)
    if path is None:
        raise primitive.error(f"an octree, {name}, that is missing", SOURCES)
    try:
        with path.open("rb") as stream:
            head = stream.read(MOST_HEAD)
    except OSError as error:
        raise primitive.error(f"{name}: {error.strerror}", SOURCES) from None
    text, _, body = head.partition(b"\n\n")
    context.budget.spend_file(primitive.place)
    fields = body[2:].split(b"\0")
    names = fields[4 : fields.index(b"", 4)] if b"" in fields[4:] else None
    if not head.startswith(b"#?RADIANCE") or OCTREE not in text + b"\n" or names is None:
        raise primitive.error(f"{name}, which is no octree", SOURCES)
    if not names:
        raise primitive.error(f"an octree, {name}, that is frozen", SOURCES)
    return [decoded(each) for each in names]


def add_mesh(primitive: Primitive, context: Context) -> None:
    """Add the OBJ file beside a compiled mesh; it has the primitive's modifier, or its own names.

    Raises
    ------
    InputError
        There is no such file, it is damaged or too large, or names a material that is not defined.
    """
    name = " ".join(primitive.strings[:1]) or "no file"
    path = _obj(name, context)
    if path is None:
        raise primitive.error(f"a compiled mesh, {name}", OBJ)
    context.budget.spend_file(primitive.place)
    context.budget.bytes -= size_of(path, max(0, context.budget.bytes))
    context.notes.add(MESHES, path.name)
    for part in read_obj(path, context.notes):
        if not len(part.quads):
            continue
        context.budget.spend_quads(len(part.quads), primitive.place)
        modifier = context.override
        if modifier is None:
            known = (n for n in part.names if n in context.definitions.latest)
            modifier = next(known, part.names[0] if part.names else "void")
        definition = context.definitions.of(modifier, primitive)
        context.surfaces.add_facets(part.quads, definition, f"{path.name}: {modifier}")


def _obj(name: str, context: Context) -> Path | None:
    """OBJ file of the same stem."""
    stem = re.sub(r"\.rtm$", "", name)
    return sought(f"{stem}.obj", context.folders) if PurePath(stem).name else None
