"""Surfaces in a band: amounts are scaled to what the case states, names find their surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from drcmitsuba.case.colour import Colour
from drcmitsuba.colour.bands import Bands
from drcmitsuba.colour.tints import Tints
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
)
from drcmitsuba.runtime.errors import InputError
from tests import ROOT
from tests.unit.colour.rooms import box, surface

BANDS = Bands.of(9)
Y = BANDS.weights("Y")
RED = (0.5, 0.3, 0.2)
PRISM = ROOT / "scenes" / "films" / "prism.xml"


def tints(spectra, **tables) -> Tints:
    return Tints(box(**tables).with_tables(colour=Colour(bands=9, spectra=spectra)), BANDS)


def test_a_reflectance_keeps_its_luminance_and_has_its_spectrum():
    made = tints({"walls": RED})
    values = np.array(
        [made.of(k, surface("wall north", Lambertian(0.4))).reflectance for k in range(9)]
    )
    assert Y @ values == pytest.approx(0.4)
    assert values[-1] > 1.5 * values[0]
    assert made.of(0, surface("floor", Lambertian(0.4))).reflectance == 0.4


def test_a_name_finds_a_wall_of_one_side_before_all_walls():
    made = tints({"walls": RED, "wall east": (0.1, 0.1, 0.8)})
    east, west = (
        made.of(0, surface(f"wall {side}", Lambertian(0.1))).reflectance
        for side in ("east", "west")
    )
    assert east > 2 * west


def test_rgb_of_the_case_needs_no_spectrum():
    made = tints({})
    values = [
        made.of(k, surface("floor", Lambertian((0.5, 0.3, 0.1)))).reflectance for k in range(9)
    ]
    assert Y @ values == pytest.approx(0.2126 * 0.5 + 0.7152 * 0.3 + 0.0722 * 0.1, rel=2e-3)


def test_a_window_takes_its_spectrum_and_the_shade_in_it_does_not():
    case = box(
        materials={
            "glass": {"type": "glazing", "transmittance": 0.6},
            "shade": {"type": "diffuser", "transmittance": 0.1},
        },
        shading={"material": "shade"},
    ).with_tables(colour=Colour(bands=9, spectra={"glass": (0.3, 0.6, 0.4)}))
    made = Tints(case, BANDS)
    glass, shade = case.materials["glass"], case.materials["shade"]
    through = np.array([made.of(k, surface("glass south", glass)).transmittance for k in range(9)])
    assert Y @ through == pytest.approx(0.6)
    assert through.std() > 0.05
    assert made.of(0, surface("glass south", shade)) is shade


@pytest.mark.parametrize(
    "material",
    [
        MirrorMaterial(type="mirror", reflectance=0.5),
        DiffuserMaterial(type="diffuser", transmittance=(0.1, 0.2, 0.3), straight=0.1),
    ],
)
def test_other_materials_are_scaled(material):
    made = tints({"thing": RED})
    of = made.of(8, surface("thing", material))
    key = "reflectance" if isinstance(material, MirrorMaterial) else "transmittance"
    before, after = (np.ravel(getattr(m, key)) for m in (material, of))
    assert (after / before) == pytest.approx(np.full(len(before), (after / before)[0]))
    assert after[0] > before[0]


def test_the_sides_of_a_fabric_take_their_own_columns(tmp_path):
    """Transmittance, reflectance of the front, which is outside, and of the back."""
    (tmp_path / "fabric.csv").write_text("380,0.1,0.2,0.6\n580,0.1,0.4,0.4\n780,0.1,0.6,0.2\n")
    fabric = DiffuserMaterial(
        type="diffuser", transmittance=0.1, reflectance=0.3, outer_reflectance=0.3
    )
    made = tints({"fabric": tmp_path / "fabric.csv"})
    first, last = (made.of(band, surface("fabric", fabric)) for band in (0, 8))
    assert first.reflectance > last.reflectance
    assert first.outer_reflectance < last.outer_reflectance


def test_a_blackout_blind_takes_a_spectrum_of_what_it_reflects():
    blind = DiffuserMaterial(type="diffuser", transmittance=0.0, reflectance=0.5)
    assert tints({"thing": RED}).of(8, surface("thing", blind)).most_through == 0


@pytest.mark.parametrize(
    ("name", "material", "words"),
    [
        ("floor", Lambertian(0.95), "a reflectance of 0.95 would be"),
        (
            "thing",
            DielectricMaterial(type="dielectric", ior=1.5),
            "a clear solid takes none",
        ),
    ],
)
def test_what_cannot_be_is_refused(name, material, words):
    with pytest.raises(InputError, match=words):
        tints({name: RED}).of(8, surface(name, material))


def test_a_film_takes_a_spectrum_that_no_band_exceeds():
    film = BsdfMaterial(type="bsdf", file=PRISM)  # sends on 94 % of the light at most
    even, red = (0.5, 0.5, 0.5), (0.9, 0.5, 0.4)
    made = [tints({"film": even}).of(k, surface("film", film)) for k in range(9)]
    assert [one.mix for one in made] == [pytest.approx((1.0,))] * 9
    words = r"colour\.spectra\.film: the film would send on 1\.\d* of the light at .*flatter"
    with pytest.raises(InputError, match=words):
        tints({"film": red}).check([surface("film", film)])


def test_a_name_that_no_surface_has_is_refused_with_the_nearest():
    with pytest.raises(InputError, match="walls"):
        tints({"wals": RED}).check(
            [surface("floor", Lambertian(0.2)), surface("wall south", Lambertian(0.2))]
        )


def test_each_side_of_a_sheet_has_its_own_spectrum():
    made = tints({"outside": RED, "ceiling": (0.2, 0.3, 0.5)})
    sheet = surface("ceiling", Lambertian(0.4, 0.3), behind="outside")
    front, back = np.array([made.of(k, sheet).sides for k in range(9)]).T
    assert [Y @ front, Y @ back] == pytest.approx([0.4, 0.3])
    assert front[0] > front[-1]
    assert back[0] < back[-1]
    alike = surface("ceiling", Lambertian(0.4), behind="outside")
    assert made.of(8, alike).sides == pytest.approx((front[8], back[8] * 0.4 / 0.3))
    one = surface("wall", Lambertian(0.4), behind="outside")
    assert made.of(8, one).sides == pytest.approx((0.4, back[8] * 0.4 / 0.3))


def test_a_note_tells_of_a_pane_that_reflects_as_grey(tmp_path):
    for columns, count in (("", 0), (",0.1,0.1", 1)):
        (tmp_path / f"glass{count}.csv").write_text(f"380,0.4{columns}\n780,0.8{columns}\n")
        made = tints({"glass": tmp_path / f"glass{count}.csv"})
        pane = surface("glass", GlazingMaterial(type="glazing", transmittance=0.6, reflectance=0.1))
        notes = [note for note in made.check([pane]) if "no reflectances" in note]
        assert len(notes) == 1 - count


def test_notes_tell_of_greys_and_of_amounts_that_differ():
    made = tints({"walls": RED})
    notes = made.check(
        [surface("wall south", Lambertian(0.1)), surface("floor", Lambertian((0.3, 0.2, 0.1))),
         surface("slab", Lambertian(0.4), behind="soffit")]
    )  # fmt: skip
    assert notes[0] == "colour: the sky's spectrum by chain, the sun's by spectrl2"
    assert "wall south: 0.1 as the case states, not the 0.34 of its spectrum" in notes[1]
    assert notes[2] == "colour: slab, soffit: grey, without a spectrum"
    assert notes[3].startswith("colour: floor: by red, green and blue")
