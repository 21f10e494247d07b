"""Sizes of the tables of what films answer."""

from __future__ import annotations

from typing import NamedTuple

from drcmitsuba_plugins.isotropic import OUT_DEPTH
from drcmitsuba_plugins.tensor import TensorTree

from drcmitsuba.case.materials import BsdfMaterial
from drcmitsuba.scene.materials import SurfaceMaterial, film
from drcmitsuba.transport.films import SUN_SAMPLES, Films


class FilmTables(NamedTuple):
    """Tables of what films answer, in one replicate.

    Parameters
    ----------
    sun_rows, sky_rows : int
    evaluated : int
        Samples of f for each sun that may shine on them.
    looking : int
        Rows of the sky's table whose directions are tested for what stands in their way.
    """

    sun_rows: int
    sky_rows: int
    evaluated: int
    looking: int


def tables_of(films: Films | None) -> FilmTables:
    """Tables of all films of a scene, in one replicate."""
    if films is None:
        return FilmTables(0, 0, 0, 0)
    mounts, owners = films.mounts, films.patches.owner
    samples = [SUN_SAMPLES["even" if m.bsdf.out_even else "uneven"] for m in mounts]
    return FilmTables(
        sun_rows=sum(mount.rows for mount in mounts),
        sky_rows=int(films.first_sky_rows()[-1]),
        evaluated=sum(m.rows * s for m, s in zip(mounts, samples, strict=True)),
        looking=sum(mounts[owner].rows for owner in owners if not mounts[owner].exposed),
    )


class OutCells(NamedTuple):
    """What is to be known of a film's plugin: its outgoing cells."""

    out_cells: int
    out_even: bool = True
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)


def out_cells(material: SurfaceMaterial) -> OutCells | None:
    """Outgoing cells of a film, as the plugins number them."""
    if not isinstance(material, BsdfMaterial):
        return None
    file = film(material.file).file
    if file.kind == "TensorTree3":
        return OutCells(1 << 2 * OUT_DEPTH, False)
    parts = file.components.values()
    return OutCells(max(1 << 2 * c.depth if isinstance(c, TensorTree) else len(c.incident)
                         for c in parts))  # fmt: skip
