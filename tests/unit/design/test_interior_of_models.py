"""E as a function of the reflectances of a model's materials, whatever file they come from."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba import load_case
from drcmitsuba.design.reflectances import Interior, reflectances, with_reflectances
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.model.model import LayerState
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky import daylight
from tests.differences import slopes
from tests.fast import slowly
from tests.model_rooms import case_of, layer
from tests.system.every_room import MODELS, OF_MODEL, SHADING, write_models
from tests.unit.design.test_design_reflectances import at, fresh
from tests.unit.model import gbxml_building

CASES = {
    "Radiance": MODELS["Radiance model with groups"],
    "mesh": MODELS["mesh"],
    "Honeybee": MODELS["Honeybee model"],
    "gbXML": OF_MODEL.format(file="house.xml", floor="floor") + SHADING,
}
"""Text of a case by the kind of its file."""
PAINT = {
    "Radiance": {"wall": 0.8, "floor": 0.4, "ceiling": 0.6},
    "mesh": {"wall": 0.3, "floor": 0.4, "ceiling": 0.6},
    "Honeybee": {"generic_wall_0.50": 0.8, "generic_floor_0.20": 0.4, "generic_ceiling_0.80": 0.6},
    "gbXML": {"floor": 0.4, "ceiling": 0.6, "wall": 0.8, "outside": 0.6},
}
"""Reflectances by name, all of which differ from those of the files."""


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def of_file(kind, folder, more="", **accuracy):
    """Case of two rooms, or of three in gbXML, whose sheets have a name on each side."""
    write_models(folder)
    gbxml_building.written(folder, gbxml_building.text(gbxml_building.surfaces().values()))
    short = CASES[kind].replace("days_per_week = 1", "days_per_week = 1\nhours = [12, 13]")
    (folder / "case.toml").write_text(short + more)
    case = load_case(folder / "case.toml")
    return case.with_tables(accuracy=case.accuracy.model_copy(update=accuracy))


@pytest.mark.parametrize("kind", slowly([*CASES], *CASES))
def test_painted_model_equals_a_fresh_simulation(tmp_path, same, kind):
    samples = {"paths": 256, "cell_size": 0.3, "cell_sky_rays": 64, "sensor_sky_rays": 256}
    case = of_file(kind, tmp_path, **samples)
    year = daylight.daylight(case)
    interiors = [
        Interior.of(case.with_tables(accuracy=case.accuracy.model_copy(update={"seed": s})), year)
        for s in range(4)
    ]
    E = np.stack([at(interior, PAINT[kind])[0] for interior in interiors])
    other = with_reflectances(
        of_file(kind, tmp_path, seed=100, replicates=8, **samples), PAINT[kind]
    )
    same(E, other=fresh(other, year), within=0.02)
    assert at(interiors[0], {})[0].mean() != pytest.approx(E.mean(), rel=0.05)


@pytest.mark.parametrize("kind", slowly([*CASES], "Radiance", "mesh", "gbXML"))
def test_gradients_by_every_material_are_the_differences(tmp_path, kind):
    case = of_file(kind, tmp_path)
    interior = Interior.of(case, daylight.daylight(case))
    names = list(interior.start)
    assert set(names) == set(PAINT[kind])

    def mean(values):
        E = interior.illuminance(dict(zip(names, values, strict=True)))
        return dr.mean(mi.Float64(E.open.array)) + 3 * dr.mean(mi.Float64(E.shaded.array))

    values = [mi.Float(interior.start[name]) for name in names]
    dr.enable_grad(values)
    dr.backward(mean(values))
    theirs = slopes(lambda x: mean([*map(mi.Float, x)])[0], [*interior.start.values()], 0.04)
    assert [value.grad[0] for value in values] == pytest.approx(theirs, rel=1e-3)


@pytest.mark.parametrize("kind", CASES)
def test_a_painted_model_is_the_case_written_with_these_reflectances(tmp_path, kind):
    painted = with_reflectances(of_file(kind, tmp_path), PAINT[kind])
    file = tmp_path / "case.toml"
    before, _, after = file.read_text().partition("[model.reflectances]")
    after = after[after.find("[sensors]") :] if after else ""
    table = "".join(f'"{name}" = {rho}\n' for name, rho in PAINT[kind].items())
    file.write_text(f"{before}{after}[model.reflectances]\n{table}")
    written = load_case(file)
    for mine, theirs in zip(painted.building.layers, written.building.layers, strict=True):
        assert (mine.names, mine.role) == (theirs.names, theirs.role)
        assert mine.material == theirs.material
    assert painted.model.reflectances == written.model.reflectances
    assert reflectances(painted) == reflectances(written) == PAINT[kind]


def square(name, material, z, **fields):
    corners = [(0, 0, z), (4, 0, z), (4, 4, z), (0, 4, z)]
    return replace(layer(name, material, corners), **fields)


def under_the_sky(*layers):
    sensors = {"corner": (1.0, 1.0, 0.5), "count": (2, 2), "spacing": 1.0}
    return case_of(*layers, model={"leaks": "allow"}, sensors=sensors)


def test_what_groups_of_a_model_change_is_no_parameter():
    blind = square("slat", Lambertian(0.6), 2.0)
    states = (LayerState("", None), LayerState("matt", Lambertian(0.3), (blind,)))
    case = under_the_sky(
        square("ground", Lambertian(0.2), 0.0),
        square("shelf", Lambertian(0.7), 2.5, group="g", states=states),
        square("slat", Lambertian(0.6), 2.8), square("matt", Lambertian(0.3), 3.0),
    )  # fmt: skip
    assert reflectances(case) == {"ground": 0.2}


@pytest.mark.parametrize(
    ("other", "got"),
    [
        (square("ground", Lambertian(0.4), 3.0), "two reflectances"),
        (square("slab", Lambertian((0.4, 0.3, 0.2)), 3.0), "make it grey"),
    ],
)
def test_indistinct_materials_of_a_model_are_refused(other, got):
    with pytest.raises(InputError, match=got) as error:
        reflectances(under_the_sky(square("ground", Lambertian(0.2), 0.0), other))
    assert error.value.field == "model.reflectances"
