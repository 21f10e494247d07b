"""The readers of files as functions that take a file and, where it can be used, come to an end."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from drcmitsuba import bsdf
from drcmitsuba.bsdf import check
from drcmitsuba.bsdf.measured import from_measurements
from drcmitsuba.case.reading import load_case
from drcmitsuba.model import gbxml, honeybee, ifc, mesh, radiance
from drcmitsuba.model.materials import GlazingMaterial, Lambertian
from drcmitsuba.model.model import Model, with_printable_names
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.materials import film
from drcmitsuba.scene.structures.mesh import read_mesh
from drcmitsuba.scene.structures.recipe import load_recipe
from drcmitsuba.scene.structures.structure import unit_cell
from drcmitsuba.sky import weather
from drcmitsuba.sky.period import read_timestamps


def read_weather(path: Path) -> None:
    """Irradiance is finite and not negative, time rises."""
    file = weather.read(path)
    for name in ("dni", "dhi"):
        assert (file.data[name].values >= 0).all()
        assert np.isfinite(file.data[name].values).all()
    assert (np.diff(file.data["time"].values) > np.timedelta64(0, "ns")).all()


def read_bsdf(path: Path) -> None:
    """A file that passes as a material sends out at most what it gets; the check shows any."""
    report = check.check(bsdf.read(path))
    assert all(isinstance(text, str) for row in report.rows() for text in row)
    material = film(path)
    directions = np.array([[0, 0, 1], [0.6, 0, 0.8], [0.6, 0, -0.8], [0, 0.99, -0.141067]])
    totals = np.sum(material.file.hemispherical(directions), axis=0)
    assert ((totals >= 0) & (totals <= 1 + 1e-6)).all(), totals


def read_measurements(path: Path) -> None:
    """The tree is finite and not negative."""
    file = from_measurements([path], depth=2)
    for tree in file.components.values():
        assert np.isfinite(tree.value).all()
        assert (tree.value >= 0).all()


def read_recipe(path: Path) -> None:
    """The structure has surfaces."""
    cell = unit_cell(load_recipe(path))
    assert len(cell.faces)
    assert np.isfinite(cell.vertices).all()


def read_a_mesh(path: Path) -> None:
    """Faces name vertices that are there."""
    vertices, faces = read_mesh(path)
    assert np.isfinite(vertices).all()
    assert faces.min() >= 0
    assert faces.max() < len(vertices)


def read_stamps(path: Path) -> None:
    """Time rises."""
    assert (np.diff(read_timestamps(path)) > np.timedelta64(0, "ns")).all()


MATERIALS = dict.fromkeys(("wall", "floor", "ceiling", "made", "box"), Lambertian(0.5)) | {
    "pane": GlazingMaterial(type="glazing", transmittance=0.6)
}
"""Materials that a case gives to meshes."""


def read_model(path: Path) -> None:
    """Surfaces have finite corners near the origin and areas, and every one has a place."""
    if path.suffix == ".rad":
        made = radiance.read([path], means=True)
    elif path.suffix == ".hbjson":
        made = honeybee.read(path)
    elif path.suffix == ".xml":
        made = gbxml.read(path)
    elif path.suffix == ".ifc":
        made = ifc.read(path)
    else:
        made = mesh.read(path, unit=1.0, materials=MATERIALS)
    _check(made)


def _check(made: Model) -> None:
    made = with_printable_names(made)
    for layer in made.layers:
        assert layer.quads.shape == (len(layer.polygon), 4, 3)
        assert np.isfinite(layer.quads).all()
        assert layer.name.isprintable()
        assert all(place.isprintable() for place in layer.places)
    for grid in made.grids:
        assert np.isfinite(grid.points).all()
        assert np.allclose(np.linalg.norm(grid.normals, axis=1), 1)
    assert all(note.isprintable() for note in made.notes)
    for space in made.spaces:
        assert space.name.isprintable()
        assert all(floor.outline.is_valid for floor in space.floors)


def read_sensors(path: Path) -> None:
    """Sensors are finite, their normals are units."""
    _check(Model(grids=(radiance.read_points(path),)))


def read_views(path: Path) -> None:
    """Views are finite."""
    for view in radiance.read_views(path):
        assert np.isfinite([*view.position, *view.direction, *view.up, *view.angles]).all()


READERS = {
    "case": (load_case, ".toml"),
    "epw": (read_weather, ".epw"),
    "tmy3": (read_weather, ".csv"),
    "tmy2": (read_weather, ".tm2"),
    "wea": (read_weather, ".wea"),
    "bsdf": (read_bsdf, ".xml"),
    "pab_opto": (read_measurements, ".txt"),
    "recipe": (read_recipe, ".toml"),
    "obj": (read_a_mesh, ".obj"),
    "ply": (read_a_mesh, ".ply"),
    "time_stamps": (read_stamps, ".csv"),
    **{f"model_{e}": (read_model, f".{e}") for e in ("rad", "hbjson", "obj", "ply", "stl")},
    **{f"model_{e}": (read_model, f".{e}") for e in ("gltf", "glb", "xml", "ifc")},
    "points": (read_sensors, ".pts"),
    "views": (read_views, ".vf"),
}
"""By name: the reader, and the suffix of its files."""


def outcome(reader, path: Path) -> str:
    """Either "result" or the line that says what is wrong; anything else is raised."""
    line, parts = "result", ["result"]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            reader(path)
    except InputError as error:
        # Texts only: an error that a local name keeps keeps its frames, and all they hold.
        line, parts = str(error), [error.source, error.field, error.got, error.remedy]
    assert line.isprintable()
    assert len(line) < 1300
    assert all(parts), line
    return line
