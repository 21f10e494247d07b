"""Materials of scene files against Radiance's formulas, its `rtrace`, and what has no twin here."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins import bsdf_file
from drcmitsuba_plugins.tensor import to_direction

from drcmitsuba.model import glass
from drcmitsuba.model.materials import (
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
    PorousMaterial,
    mean_by_incidence,
)
from drcmitsuba.model.radiance import read
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.materials import bsdf
from tests import radiance, skips

ROUGH = {"roughness": 0.2, "distribution": "beckmann"}
SQUARE = " polygon p 0 0 12 -9 -9 0 9 -9 0 9 9 0 -9 9 0\n"
WALL = " polygon wall 0 0 12 0 0 0 1 0 0 1 0 1 0 0 1\n"
needs_radiance = skips.RADIANCE.mark


def model_of(text, folder, **options):
    (folder / "x.rad").write_text(text)
    return read([folder / "x.rad"], **options)


def material(text, folder, **options):
    """Material of a surface with the modifier m."""
    (layer,) = model_of(f"{text}\nm{SQUARE}", folder, **options).layers
    return layer.material


def seen(text, folder, incidence, side):
    """Radiance (angle, 3) seen from below in a square under a glow of 1 that is above or below."""
    z = {"above": 1, "below": -1}[side]
    sky = f"void glow g 0 0 4 1 1 1 0\ng source s 0 0 4 0 0 {z} 180\n"
    (folder / "r.rad").write_text(f"{text}\nm{SQUARE}{sky}")
    (folder / "r.oct").write_bytes(radiance.run(["oconv", "r.rad"], folder))
    t = np.radians(incidence)
    rays = [f"0 0 -1e-3 {np.sin(a):.9g} 0 {np.cos(a):.9g}\n" for a in t]
    command = ["rtrace", "-h", "-ov", "-ab", "1", "-ad", "256", "-aa", "0", "r.oct"]
    return np.array(radiance.run(command, folder, "".join(rays).encode()).split(), float).reshape(
        -1, 3
    )


def test_transmittance_and_transmissivity_follow_the_manual():
    for t_n in (0.1, 0.65, 0.96, 1.0):
        tau, _ = glass.pane(np.array([t_n]), 1.52, np.ones(1))
        transmittance = float(tau[0, 0])
        assert glass.transmissivity(transmittance, 1.52) == pytest.approx(t_n, abs=1e-9)
        # The formula of Radiance's reference manual, for an index of 1.52.
        root = np.sqrt(0.8402528435 + 0.0072522239 * transmittance**2)
        manual = (root - 0.9166530661) / 0.0036261119 / transmittance
        assert manual == pytest.approx(t_n, abs=2e-6)
    assert glass.transmissivity(glass.most(1.52), 1.52) == pytest.approx(1)
    for ior in (1.0001, 1.05, 4.0):  # nearly air: nothing is lost of it, nor taken for black
        assert glass.transmissivity(glass.most(ior), ior) == pytest.approx(1)


@needs_radiance
@pytest.mark.parametrize("index", [None, 1.7])
def test_panes_are_those_that_rtrace_sees(index, tmp_path):
    incidence = np.array([0, 30, 45, 60, 75, 85])
    t_n = np.array([0.3, 0.65, 0.96])
    count = "3" if index is None else "4"
    text = f"void glass m 0 0 {count} .3 .65 .96 {index or ''}"
    tau, rho = glass.pane(t_n, index or 1.52, np.cos(np.radians(incidence)))
    np.testing.assert_allclose(seen(text, tmp_path, incidence, "above"), tau, atol=2e-5)
    np.testing.assert_allclose(seen(text, tmp_path, incidence, "below"), rho, atol=2e-5)


def engine(pane, incidence):
    if pane.ior is not None:
        return np.interp(
            np.cos(np.radians(incidence)), np.linspace(0, 1, 1025), pane.tables(1025)[0]
        )
    return pane.transmittance * (1 - (1 - np.cos(np.radians(incidence))) ** pane.exponent)


LOW_E = (
    "void BRTDfunc m 10 sr_clear_r sr_clear_g sr_clear_b st_clear_r st_clear_g st_clear_b 0 0 0 "
    "glaze1.cal 0 19 0 0 0 0 0 0 0 0 0 {side} .07 .07 .07 .13 .13 .13 .76 .76 .76"
)
DOUBLE = (
    "void BRTDfunc m 10 if(Rdot,cr(fr(0.1),ft(0.7),fr(0.08)),cr(fr(.2),ft(.7),rclr)) "
    "'if(Rdot,cr(fr(0.1),ft(0.7),fr(0.08)),cr(fr(.2),ft(.7),rclr))' "
    "if(Rdot,cr(fr(0.1),ft(0.7),fr(0.08)),cr(fr(.2),ft(.7),rclr)) "
    "ft(0.7)*tclr ft(0.7)*tclr ft(0.7)*tclr 0 0 0 glaze2.cal 0 9 0 0 0 0 0 0 0 0 0"
)


@needs_radiance
@pytest.mark.parametrize(
    ("text", "deviation"),
    [
        ("void glass m 0 0 3 1 1 1", 5e-5),
        ("void glass m 0 0 3 .96 .96 .96", 5e-5),
        ("void glass m 0 0 3 .65 .65 .65", 5e-5),
        ("void glass m 0 0 3 .2 .2 .2", 5e-5),
        ("void glass m 0 0 4 .9 .9 .9 1.7", 5e-5),
        (LOW_E.format(side=1), 0.05),
        (LOW_E.format(side=-1), 0.05),
        (DOUBLE, 0.06),
        ("void BRTDfunc m 10 .1 .1 .1 .6 .6 .6 0 0 0 . 0 9 0 0 0 0 0 0 0 0 0", 0.35),
    ],
)
def test_a_glazing_is_radiances_at_normal_incidence_and_near_it_elsewhere(
    text, deviation, tmp_path
):
    incidence = np.arange(0, 90, 5)
    pane = material(text, tmp_path)
    assert isinstance(pane, GlazingMaterial)
    through = seen(text, tmp_path, incidence, "above")[:, 1]
    assert pane.transmittance == pytest.approx(through[0], abs=1e-5)
    assert np.abs(engine(pane, incidence) - through).max() < deviation


@needs_radiance
@pytest.mark.parametrize(
    "text",
    [
        "void plastic m 0 0 5 .5 .4 .3 .04 .1",
        "void plastic m 0 0 5 .5 .4 .3 .2 .1",
        "void metal m 0 0 5 .7 .7 .7 .03 .1",
        "void metal m 0 0 5 .7 .7 .7 .9 .1",
        "void trans m 0 0 7 .8 .7 .6 0 0 .6 0",
        "void trans m 0 0 7 .8 .7 .6 .03 .1 .6 .05",
    ],
)
def test_light_reflected_and_transmitted_in_all_is_radiances(text, tmp_path):
    finish = material(text, tmp_path)
    options = {"incidence": [0.0], "folder": tmp_path}
    reflected = seen(text, side="below", **options)[0]
    weights = np.array([0.2126, 0.7152, 0.0722])
    if isinstance(finish, Lambertian):
        np.testing.assert_allclose(np.broadcast_to(finish.reflectance, 3), reflected, atol=4e-3)
    else:
        assert finish.reflectance == pytest.approx(reflected @ weights, abs=4e-3)
    if isinstance(finish, DiffuserMaterial):
        through = seen(text, side="above", **options)[0]
        assert finish.transmittance == pytest.approx(through @ weights, abs=4e-3)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("void plastic m 0 0 5 .5 .5 .5 0 0", Lambertian(0.5)),
        ("void plastic m 0 0 5 .5 .4 .3 0 0", Lambertian((0.5, 0.4, 0.3))),
        ("void plastic m 0 0 5 .5 .5 .5 .04 .1", Lambertian(0.52)),
        ("void metal m 0 0 5 .5 .5 .5 .04 .1", Lambertian(0.5)),
        (
            "void metal m 0 0 5 .9 .9 .9 1 0",
            MirrorMaterial(type="mirror", reflectance=0.9),
        ),
        (
            "void metal m 0 0 5 .8 .8 .8 .5 .2",
            MirrorMaterial(type="mirror", reflectance=0.8, specular=0.5, **ROUGH),
        ),
        (
            "void metal2 m 4 0 0 1 . 0 6 .8 .8 .8 .5 .1 .4",
            MirrorMaterial(type="mirror", reflectance=0.8, specular=0.5, **ROUGH),
        ),
        (
            "void plastic m 0 0 5 .5 .5 .5 .2 0",
            MirrorMaterial(type="mirror", reflectance=0.6, specular=1 / 3),
        ),
        ("void mirror m 0 0 3 .85 .85 .85", MirrorMaterial(type="mirror", reflectance=0.85)),
        (
            "void trans m 0 0 7 .8 .8 .8 0 0 .25 0",
            DiffuserMaterial(type="diffuser", transmittance=0.2, reflectance=0.6),
        ),
        (
            "void dielectric m 0 0 5 .5 .5 .5 1.5 0",
            DielectricMaterial(type="dielectric", ior=1.5, absorption=np.log(2)),
        ),
        (
            "void interface m 0 0 8 1 1 1 1.5 1 1 1 1",
            DielectricMaterial(type="dielectric", ior=1.5),
        ),
        ("void light m 0 0 3 10 10 10", Lambertian(0.0)),
        ("void plastic a 0 0 5 .5 .5 .5 0 0\nvoid illum m 1 a 0 3 9 9 9", Lambertian(0.5)),
        ("void plastic a 0 0 5 .3 .3 .3 0 0\nvoid alias m a", Lambertian(0.3)),
        (
            "void brightfunc half 2 A1/2 . 0 1 1\nhalf plastic a 0 0 5 .6 .6 .6 0 0\n"
            "inherit alias m a",
            Lambertian(0.3),
        ),
        (
            "void colorfunc tint 4 1 .5 .5 . 0 0\ntint plastic a 0 0 5 .6 .6 .6 0 0\n"
            "void alias m a",
            Lambertian(0.6),
        ),
        (
            "void plastic a 0 0 5 .6 .6 .6 0 0\na colorfunc m 4 1 .5 .5 . 0 0",
            Lambertian((0.6, 0.3, 0.3)),
        ),
        (
            "void plastic a 0 0 5 .6 .6 .6 0 0\nvoid mixfunc m 4 void a 0 . 0 0",
            Lambertian(0.6),
        ),
        (
            "void plastic a 0 0 5 .8 .8 .8 0 0\nvoid plastic b 0 0 5 .5 .5 .5 0 0\n"
            "void mixfunc m 4 b a A1 . 0 1 .3",
            Lambertian(0.3 * 0.5 + 0.7 * 0.8),
        ),
        (
            "void plastic a 0 0 5 .8 .4 .4 0 0\nvoid mixfunc b 4 a a .5 . 0 0\n"
            "void plastic c 0 0 5 .2 .2 .2 0 0\nvoid mixfunc m 4 b c .5 . 0 0",
            Lambertian((0.5, 0.3, 0.3)),
        ),
        (
            "void plastic a 0 0 5 .6 .6 .6 0 0\nvoid mixfunc m 4 void a .25 . 0 0",
            PorousMaterial(type="porous", porosity=0.25, reflectance=0.6),
        ),
        (
            "void plastic a 0 0 5 .6 .6 .6 0 0\nvoid plastic b 0 0 5 .2 .2 .2 0 0\n"
            "void mixfunc m 4 a b if(Rdot,1,0) . 0 0",
            Lambertian(0.6, 0.2),
        ),
        (
            "void plastic a 0 0 5 .6 .6 .6 0 0\nvoid plastic b 0 0 5 .2 .2 .2 0 0\n"
            "void mixfunc m 4 a b if(-Rdot,1,0) . 0 0",
            Lambertian(0.2, 0.6),
        ),
        (
            "void plastic a 0 0 5 .6 .6 .6 0 0\nvoid plastic b 0 0 5 .2 .2 .2 0 0\n"
            "void plastic c 0 0 5 .4 .4 .4 0 0\nvoid mixfunc n 4 a b if(Rdot,1,0) . 0 0\n"
            "void mixfunc m 4 n c if(Rdot,0,1) . 0 0",
            Lambertian(0.4, 0.2),
        ),
        (
            "void plastic m 0 0 5 .6 .6 .6 0 0\nm plastic m 0 0 5 .2 .2 .2 0 0"
            "\nvoid plastic m 0 0 5 .1 .1 .1 0 0",
            Lambertian(0.1),
        ),
    ],
)
def test_a_material_has_its_counterpart(text, expected, tmp_path):
    given = material(text, tmp_path)
    assert type(given) is type(expected)
    for field in (
        "reflectance",
        "behind",
        "transmittance",
        "porosity",
        "roughness",
        "specular",
        "ior",
        "absorption",
    ):
        if hasattr(expected, field):
            assert getattr(given, field) == pytest.approx(getattr(expected, field)), field


def test_a_scaled_solid_absorbs_as_much_on_its_way_through(tmp_path):
    (tmp_path / "a.rad").write_text(f"void dielectric m 0 0 5 .5 .5 .5 1.5 0\nm{SQUARE}")
    (tmp_path / "b.rad").write_text("!xform -s 2 a.rad\n!xform -s .5 a.rad\n")
    large, small = read([tmp_path / "b.rad"]).layers
    assert [large.name, small.name] == ["m", "m (2)"]
    assert large.material.absorption == pytest.approx(np.log(2) / 2)
    assert small.material.absorption == pytest.approx(2 * np.log(2))


@pytest.mark.parametrize("pattern", ["brightfunc p 2 .5 . 0 0", "colorfunc p 4 .5 .5 .5 . 0 0"])
def test_a_pattern_on_glass_multiplies_what_it_lets_through(pattern, tmp_path):
    made = material(f"void {pattern}\np glass m 0 0 3 .9 .9 .9", tmp_path)
    cosine = np.array([1.0, 0.8, 0.6, 0.4])
    through, back = (part[:, 0] for part in glass.pane(np.array([0.9]), 1.52, cosine))
    ours = made.transmittance * (1 - (1 - cosine) ** made.exponent)
    np.testing.assert_allclose(ours, 0.5 * through, atol=0.01)
    assert made.reflectance == pytest.approx(back[0])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("void plastic m 0 0 5 1.2 .5 .5 0 0", "plastic 'm': a colour of 1.2"),
        ("void plastic m 0 0 4 .5 .5 .5 0", "plastic 'm': 0 strings and 4 numbers"),
        ("void metal2 m 0 0 6 .5 .5 .5 .9 .1 .1", "metal2 'm': 0 strings"),
        ("void plastic m 0 0 5 .5 .5 .5 0 -.1", "plastic 'm': a roughness of -0.1"),
        ("void metal m 0 0 5 .5 .5 .5 .9 -.1", "metal 'm': a roughness of -0.1"),
        ("void trans m 0 0 7 .5 .5 .5 0 -.1 .5 0", "trans 'm': a roughness of -0.1"),
        ("void glass m 0 0 4 .9 .9 .9 1", "a refractive index of 1"),
        ("void dielectric m 0 0 5 0 0 0 1.5 0", "a transmission of 0"),
        ("void interface m 0 0 8 1 1 1 1.5 1 1 1 1.3", "not air"),
        ("void antimatter m 0 0 0", "antimatter 'm': a material without a counterpart"),
        ("void mist m 0 0 0", "mist 'm'"),
        ("void transfunc m 2 f g.cal 0 6 .1 .1 .1 0 .5 .5", "transfunc 'm'"),
        ("void ashik2 m 4 1 0 0 . 0 8 .3 .1 .05 .05 .05 .08 5 30", "ashik2 'm'"),
        ("void BRTDfunc m 10 0 0 0 0 0 0 0 0 0 my.cal 0 9 0 0 0 0 0 0 0 0 0", "'my.cal'"),
        ("void BRTDfunc m 10 0 0 0 0 0 0 f f f . 0 9 0 0 0 0 0 0 .1 .1 .1", "depend on the source"),
        ("void BRTDfunc m 10 0 0 0 .6 .6 .6 0 0 0 . 0 9 0 0 0 .4 .4 .4 .1 .1 .1", "no shares"),
        ("void BRTDfunc m 10 .1 .1 .1 .6 .6 .6 0 0 0 . 0 9 nan 0 0 0 0 0 0 0 0", "no shares"),
        ("void BRTDfunc m 10 .1 .1 .1 .6 .6 .6 0 0 0 . 0 9 inf 0 0 0 0 0 0 0 0", "no shares"),
        ("void BRTDfunc m 10 0 0 0 1/0 0 0 0 0 0 . 0 9 0 0 0 0 0 0 0 0 0", "no shares"),
        ("void BRTDfunc m 10 0 0 0 Px 0 0 0 0 0 . 0 9 0 0 0 0 0 0 .1 .1 .1", "'Px'"),
        ("void BRTDfunc m 10 RdotP 0 0 0 0 0 0 0 0 . 0 9 0 0 0 0 0 0 0 0 0", "'RdotP'"),
        ("void BRTDfunc m 10 .6 0 0 .6 0 0 0 0 0 . 0 9 0 0 0 0 0 0 0 0 0", "no shares"),
        ("void mirror m 1 void 0 3 .5 .5 .5", "void as its alternate material"),
        ("void colorpict c 7 a b c d e f g 0 0\nc plastic m 0 0 5 .5 .5 .5 0 0", "colorpict 'c'"),
        ("void texfunc c 4 x y z f.cal 0 0\nc plastic m 0 0 5 .5 .5 .5 0 0", "texfunc 'c'"),
        ("void mixfunc m 4 void void x f.cal 0 0", "mixfunc 'm': a mixture"),
        ("void mixfunc m 4 void void Rdot . 0 0", "mixfunc 'm': a mixture that is not the same"),
        (
            "void mirror b 0 0 3 .9 .9 .9\nvoid mixfunc m 4 b void if(Rdot,1,0) . 0 0",
            "one is not diffuse",
        ),
        (
            "void plastic a 0 0 5 .5 .5 .5 0 0\nvoid mirror b 0 0 3 .9 .9 .9\n"
            "void mixfunc m 4 a b .3 . 0 0",
            "mixfunc 'm': a mixture of 30 % of materials that are not both diffuse or void",
        ),
        (
            "void plastic m 0 0 5 .5 .5 .5 0 0\n" + 20 * "void mixfunc m 4 m m .5 . 0 0\n",
            "mixfunc 'm': mixtures of 21 modifiers within each other",
        ),
        ("void brightfunc b 2 1.2 . 0 0\nb glass m 0 0 3 .96 .96 .96", "a pattern under which it"),
        ("void brightfunc b 2 1.06 . 0 0\nb glass m 0 0 3 .96 .96 .96", "a pattern under which it"),
        ("void brightfunc b 2 .5 . 0 0\nb BSDF m 6 0 a.xml 0 0 1 . 0 0", "a pattern other than 1"),
        ("void plastic a 0 0 5 0 0 0 0 0\na plastic m 0 0 5 0 0 0 0 0", "modified by 'a'"),
        ("void alias m nothing", "'nothing' is not defined"),
        ("void wood m 0 0 0", "wood 'm': no kind of primitive"),
    ],
)
def test_what_has_no_counterpart_is_refused_by_name(text, complaint, tmp_path):
    with pytest.raises(InputError) as error:
        material(text, tmp_path)
    assert complaint in str(error.value)
    assert "x.rad: line " in str(error.value)


def test_materials_that_no_surface_has_are_not_judged(tmp_path):
    text = f"void antimatter a 0 0 0\nvoid plastic m 0 0 5 .5 .5 .5 0 0\nm{SQUARE}"
    assert len(model_of(text, tmp_path).layers) == 1


def test_means_take_patterns_as_one_and_name_them(tmp_path):
    text = (
        "void colorpict c 7 a b c d e f g 0 0\nc plastic a 0 0 5 .5 .5 .5 0 0\n"
        f"void metal b 0 0 5 .6 .6 .6 0 0\nvoid mixfunc m 4 a b x f.cal 0 0\nm{SQUARE}"
        f"void mixtext t 4 a b f t 0 0\nt{SQUARE}"
    )
    first, second = model_of(text, tmp_path, means=True).layers
    assert (first.material, second.material) == (Lambertian(0.5), Lambertian(0.6))
    assert model_of(text, tmp_path, means=True).notes == (
        "Mixtures count as their first material, text as its background: m, t.",
        "Patterns and textures count as their mean of 1: c.",
    )


def test_roles_names_and_notes(tmp_path):
    text = (
        "void glow sky 0 0 4 1 1 1 0\nsky source s 0 0 4 0 0 1 180\n"
        f"void plastic a 0 0 5 .5 .5 .5 .02 0\na{WALL}\nvoid glass b 0 0 3 .9 .9 .9\nb{WALL}\n"
        f"void light c 0 0 3 1 1 1\nc{WALL}\nvoid{WALL}\nvoid illum d 0 0 3 1 1 1\nd{WALL}"
    )
    model = model_of(text, tmp_path)
    assert {layer.name: layer.role for layer in model.layers} == {
        "a": "surface",
        "b": "pane",
        "c": "surface",
    }
    assert model.notes == (
        "Suns, skies and grounds of the source files are left out: the weather file gives them.",
        "Smooth surfaces that mirror at most 5 % do so where they are grey, alike on both sides, "
        "in six planes or fewer and in no group; elsewhere this light counts as diffuse, which "
        "lowers the illuminance in a room of them by 1 %: a.",
        "Daylight is the only light: lamps are black: c.",
        "Surfaces without a material are left out.",
    )


@pytest.fixture
def pane(tmp_path):
    (tmp_path / "film.xml").write_text("<xml/>")

    def layers(kind, up, wall=WALL, extra=""):
        thick = "0 " if kind == "BSDF" else ""
        count = 5 + len(thick.split()) + len(extra.split())
        text = f"void {kind} m {count} {thick}film.xml {up} . {extra} 0 0\nm{wall}"
        return model_of(text, tmp_path).layers

    return layers


LEVEL = " polygon roof 0 0 12 0 0 0 1 0 0 1 1 0 0 1 0\n"


@pytest.mark.parametrize(
    ("up", "wall", "extra", "turn"),
    [
        ("0 0 1", WALL, "", False),
        ("0 0 -1", WALL, "", True),
        ("0 .7 .5", WALL, "", False),
        ("0 1 0", WALL, "-rx 90", False),
        ("0 1 0", WALL, "-rx -90", True),
        ("0 1 0", LEVEL, "", False),
        ("0 -1 0", LEVEL, "", True),
    ],
)
def test_a_film_is_mounted_as_its_up_vector_says(up, wall, extra, turn, pane):
    (layer,) = pane("BSDF", up, wall, extra)
    assert (layer.material.turn, layer.material.straight_through) == (turn, "auto")
    assert (layer.role, layer.material.flip) == ("pane", False)
    assert pane("aBSDF", up, wall, extra)[0].material.straight_through == "on"


def test_films_move_with_the_files_that_they_stand_in(pane, tmp_path):
    pane("BSDF", "0 0 1")
    (tmp_path / "turned.rad").write_text("!xform -a 2 -rx 180 -i 1 -rz 30 x.rad\n")
    up, down = read([tmp_path / "turned.rad"]).layers
    assert [up.material.turn, down.material.turn] == [False, True]
    assert len(up.quads) == len(down.quads) == 1


@pytest.mark.parametrize(("up", "wall"), [("1 0 1", WALL), ("0 0 1", LEVEL), ("0 1 0", WALL)])
def test_a_film_that_lies_askew_is_refused(up, wall, pane):
    with pytest.raises(InputError, match="neither up nor down"):
        pane("BSDF", up, wall)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("BSDF m 6 .1 film.xml 0 0 1 . 0 0", "a thickness of .1"),
        ("BSDF m 6 t film.xml 0 0 1 . 0 0", "unknown name 't'"),
        ("BSDF m 6 0 film.xml 0 0 1 f.cal 0 0", "function file 'f.cal'"),
        ("BSDF m 6 0 film.xml 0 0 1 . 0 3 .1 .1 .1", "diffuse parts"),
        ("BSDF m 6 0 gone.xml 0 0 1 . 0 0", "no file 'gone.xml'"),
        ("aBSDF m 4 film.xml 0 0 1 0 0", "4 strings"),
        ("aBSDF m 7 film.xml 0 0 1 . -q 2 0 0", "the transform '-q 2'"),
    ],
)
def test_a_film_that_cannot_be_followed_is_refused(text, complaint, pane, tmp_path):
    pane("BSDF", "0 0 1")
    with pytest.raises(InputError) as error:
        material(f"void {text}", tmp_path)
    assert complaint in str(error.value)


FABRIC = """{ a fabric with a cut-off {angle}; }
z = acos(abs(bound(-1,Rdot,1)))/PI*2;
pow(a,b) = if(a, exp(b*log(a)), 0);
a = 0.5;
tau(t0,cut) = if(cut/90-z, t0*(1 - a*pow(z+1-cut/90,2) - (1-a)*pow(z+1-cut/90,8)), 0);
"""


@needs_radiance
@pytest.mark.parametrize("below", [".1 .1 .1", ".2 .2 .2"])
def test_a_fabric_by_its_function_file(below, tmp_path):
    """τ(θ) to the cut-off, Lambertian parts: as `rtrace` sees the sky through it and in it."""
    (tmp_path / "fabric.cal").write_text(FABRIC)
    through = "tau(.3,75) tau(.3,75) tau(.3,75)"
    text = f"void BRTDfunc m 10 0 0 0 {through} 0 0 0 fabric.cal 0 9 .1 .1 .1 {below} .04 .04 .04"
    model = model_of(f"{text}\nm{SQUARE}", tmp_path)
    assert any("0.10, and not that of their back, 0.20" in n for n in model.notes) == (
        below != ".1 .1 .1"
    )
    (layer,) = model.layers
    pane = layer.material
    assert (layer.role, pane.type) == ("pane", "diffuser")
    assert (pane.transmittance, pane.reflectance) == (pytest.approx(0.04), pytest.approx(0.1))
    angles = np.array([0, 30, 60, 70, 74, 80])
    tau = np.interp(np.cos(np.radians(angles)), np.linspace(0, 1, 513), pane.straight)
    above = seen(text, tmp_path, angles, "above")[:, 1]
    np.testing.assert_allclose(tau + 0.04, above, atol=1e-3)
    assert above[0] > 0.3
    assert above[-1] == pytest.approx(0.04, abs=1e-3)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("tau=tau", "do its definitions call themselves"),
        ("tau=other", "unknown name 'other'"),
        ("tau=(1", "')' is missing"),
        ("{ tau=1;", "no partner"),
        ("tau=2;", "no shares of the light: 0 … 2"),
        ("tau=" + "0+" * 40_000 + "0;", "more than 65536 bytes"),
    ],
)
def test_a_function_file_that_cannot_be_followed_is_refused(text, complaint, tmp_path):
    (tmp_path / "f.cal").write_text(text)
    with pytest.raises(InputError) as error:
        material("void BRTDfunc m 10 0 0 0 tau tau tau 0 0 0 f.cal 0 9 0 0 0 0 0 0 0 0 0", tmp_path)
    assert complaint in str(error.value)
    assert "\n" not in str(error.value)
    assert "x.rad: line " in str(error.value)


def test_files_are_looked_for_beside_the_other_scene_files(tmp_path):
    """A pane in a folder of options names a function file that stands beside the office."""
    (tmp_path / "options").mkdir()
    pane = "void BRTDfunc m 10 0 0 0 t t t 0 0 0 f.cal 0 9 0 0 0 0 0 0 .1 .1 .1\n"
    (tmp_path / "options" / "pane.rad").write_text(f"{pane}m{SQUARE}")
    (tmp_path / "office.rad").write_text(f"void plastic p 0 0 5 .5 .5 .5 0 0\np{SQUARE}")
    (tmp_path / "f.cal").write_text("t = 0.25;")
    first, _ = read([tmp_path / "options" / "pane.rad", tmp_path / "office.rad"]).layers
    assert first.material.most_straight == 0.25


@needs_radiance
def test_trans_that_scatters_nothing_is_porous(tmp_path):
    text = "void trans m 0 0 7 .7 .7 .7 0 0 .8 1"
    leaf, incidence = material(text, tmp_path), np.array([0, 45, 80])
    assert leaf.type == "porous"
    np.testing.assert_allclose(seen(text, tmp_path, incidence, "above"), leaf.porosity, atol=1e-5)
    reflected = (1 - leaf.porosity) * leaf.reflectance
    np.testing.assert_allclose(seen(text, tmp_path, [0], "below"), reflected, atol=4e-3)


@needs_radiance
@pytest.mark.parametrize(
    ("numbers", "note"),
    [("0 0 .8 .5", ""), (".1 0 .8 .5", "10 % of the light")],
)
def test_trans_lets_a_part_straight_through(numbers, note, tmp_path):
    """Straight and scattered light together, and the straight part alone by a hole in the sky."""
    text, angles = f"void trans m 0 0 7 .7 .7 .7 {numbers}", np.array([0, 45, 70, 80])
    model = model_of(f"{text}\nm{SQUARE}", tmp_path)
    assert any(note in each for each in model.notes) or not note
    pane = model.layers[0].material
    assert pane.type == "diffuser"
    tau = at_angles(pane.straight, angles)
    above = seen(text, tmp_path, angles, "above")[:, 1]
    # The sky's scattered light depends on the eye's angle in Radiance: its mean is right.
    np.testing.assert_allclose(tau + pane.scattered, above, atol=0.11 if note else 1e-3)
    s = float(numbers.split()[0])
    more = np.exp(-5.85 * np.cos(np.radians(angles))) - np.exp(-5.85) if s else 0
    np.testing.assert_allclose(tau, 0.7 * 0.4 * (1 - s) * (1 - more), atol=1e-4)


@needs_radiance
@pytest.mark.parametrize("specularity", [0.0, 0.07])
def test_trans_scatters_suns_by_their_angle_as_in_radiance(specularity, tmp_path):
    """Seen from straight below: L = T(θ) cos θ Ω / π of a sun of radiance 1.

    F of Radiance, of which it takes off that of the eye, too, is 0.00085 at normal incidence.
    """
    text, angles = f"void trans m 0 0 7 .8 .8 .8 {specularity} 0 .7 .5", np.array([20, 50, 77])
    pane, glow = material(text, tmp_path), []
    for a in np.radians(angles):
        sun = f"void light l 0 0 3 1e6 1e6 1e6\nl source s 0 0 4 {np.sin(a)} 0 {np.cos(a)} 0.5\n"
        (tmp_path / "r.rad").write_text(f"{text}\nm{SQUARE}{sun}")
        (tmp_path / "r.oct").write_bytes(radiance.run(["oconv", "r.rad"], tmp_path))
        command = ["rtrace", "-h", "-ov", "-ab", "0", "-dj", "0", "-dt", "0", "r.oct"]
        ray = b"0 0 -1e-3 0 0 1\n"
        glow.append(float(radiance.run(command, tmp_path, ray).split()[1]) / 1e6)
    omega = 2 * np.pi * (1 - np.cos(np.radians(0.25)))
    theirs = np.pi * np.array(glow) / omega / np.cos(np.radians(angles))
    np.testing.assert_allclose(at_angles(pane.transmittance, angles), theirs, rtol=3e-3)


def at_angles(share, angles):
    """Share of the light of a pane at incidences [deg]."""
    steps = np.linspace(0, 1, np.size(share)) if np.size(share) > 1 else [0]
    return np.interp(np.cos(np.radians(angles)), steps, np.ravel(share))


def test_the_mean_of_a_share_over_a_hemisphere_is_that_of_its_integral():
    c = np.linspace(0, 1, 9)
    assert mean_by_incidence(0.3) == 0.3
    assert mean_by_incidence(tuple(0.1 + 0.6 * c)) == pytest.approx(0.1 + 0.4)  # 2 ∫ (a + b c) c dc


@pytest.mark.parametrize("alpha", [0.1, 0.3])
def test_trans_with_roughness_has_a_lobe_of_its_width(alpha, tmp_path):
    """A share within δ of the straight direction of 1 − exp(−δ²/α²), on top of the even part."""
    text = f"void trans m 0 0 7 .8 .8 .8 0 {alpha} .7 .5"
    (layer,) = model_of(f"{text}\nm{SQUARE}", tmp_path).layers
    assert (layer.role, layer.material.type) == ("pane", "bsdf")
    file = bsdf_file.read(layer.material.file)
    tree = file.component("tb")
    below = np.array([[0, 0, -1.0], [-0.5, 0, -np.sqrt(0.75)]])
    np.testing.assert_allclose(tree.hemispherical(below), 0.56, rtol=2e-3)
    u = (np.arange(512) + 0.5) / 512
    out = to_direction(*(x.ravel() for x in np.meshgrid(u, u)))
    f = tree.values(np.broadcast_to(below[0], out.shape), out) - 0.28 / np.pi
    for width in (0.5, 1.0, 1.5):
        near = np.arccos(out[:, 2]) < width * alpha
        share = (np.pi * f * near).mean() / 0.28
        assert share == pytest.approx(1 - np.exp(-(width**2)), abs=0.03)
    assert file.components["rf"].albedos()[0] == pytest.approx(0.24, rel=1e-3)


@pytest.mark.parametrize("alpha", [0.01, 0.05])
def test_a_lobe_narrower_than_a_cell_is_widened_with_a_note(alpha, tmp_path):
    model = model_of(f"void trans m 0 0 7 .8 .8 .8 0 {alpha} .7 .5\nm{SQUARE}", tmp_path)
    assert any("below 0.03 rad" in note for note in model.notes) == (alpha < 0.03)


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("void mirror m 0 0 3 .9 .7 .4", "up to 0.4 off that of a channel"),
        ("void glass m 0 0 3 .8 .7 .7", "up to 0.1 off that of a channel"),
        ("void metal2 m 4 0 0 1 . 0 6 .8 .8 .8 .5 .1 .4", "up to 4 times apart"),
        ("void metal2 m 4 0 0 1 . 0 6 .8 .8 .8 .5 0 .4", "of which one is 0"),
        ("void trans2 m 4 0 0 1 . 0 8 .8 .8 .8 0 .1 .2 .7 .5", "up to 2 times apart"),
        ("void dielectric m 0 0 5 1 1 1 1.5 4", "Hartmann's constant 4"),
        ("void BRTDfunc m 10 .1 .1 .1 0 0 0 0 0 0 . 0 9 .1 .1 .1 .1 .1 .1 .2 .2 .2", "to 10 %"),
    ],
)
def test_a_note_on_what_is_approximated_has_its_size(text, size, tmp_path):
    notes = model_of(f"{text}\nm{SQUARE}", tmp_path).notes
    assert sum(size in note for note in notes) == 1


@needs_radiance
@pytest.mark.parametrize(
    ("alpha", "within", "lost"), [(0.05, 4.0, 0), (0.1, 8.0, 0), (0.3, 24.0, 4)]
)
def test_rough_surfaces_have_lobes_as_wide_as_radiances(alpha, within, lost, tmp_path):
    """Share of the mirrored light within a cone at 45°, in which Radiance has about half of it."""
    backend.select()
    text, r = f"void metal m 0 0 5 1 1 1 1 {alpha}", np.sqrt(0.5)
    (layer,) = (model := model_of(f"{text}\nm{SQUARE}", tmp_path)).layers
    noted = [note for note in model.notes if "of what is mirrored" in note]
    assert len(noted) == (lost > 0)
    assert all(f"about {lost} %" in note for note in noted)
    cap = f"void glow g 0 0 4 1 1 1 0\ng source s 0 0 4 {r} 0 {-r} {2 * within}\n"
    (tmp_path / "r.rad").write_text(f"{text}\nm{SQUARE}{cap}")
    (tmp_path / "r.oct").write_bytes(radiance.run(["oconv", "r.rad"], tmp_path))
    rays = f"{-r} 0 {-r} {r} 0 {r}\n" * 4096
    command = ["rtrace", "-h", "-ov", "-ab", "0", "-st", "0", "r.oct"]
    theirs = np.array(radiance.run(command, tmp_path, rays.encode()).split(), float)
    count, rng = 1 << 16, np.random.default_rng(4)
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.wi = mi.Vector3f(float(r), 0, float(r))
    u, v, w = (mi.Float(rng.random(count)) for _ in range(3))
    bs, weight = mi.load_dict(bsdf(layer.material)).sample(
        mi.BSDFContext(), si, u, mi.Point2f(v, w)
    )
    share, light = np.array(bs.wo.z - bs.wo.x) * r > np.cos(np.radians(within)), np.array(weight[0])
    assert light.mean() == pytest.approx(1 - lost / 100, abs=0.011)
    assert (light * share).sum() / light.sum() == pytest.approx(theirs[::3].mean(), abs=0.06)


@pytest.mark.parametrize("kind", ["plastic", "metal"])
@pytest.mark.parametrize(("s", "polished"), [(0.3, True), (0.03, True), (0.01, False)])
def test_smooth_surfaces_mirror_more_at_grazing_incidence_as_in_radiance(
    kind, s, polished, tmp_path
):
    """R = d (1 − F) + m + (1 − m) F where s ≥ 0.018, m = s of plastic and C s of metal."""
    backend.select()
    angles = np.array([0.0, 45.0, 70.0, 85.0])
    text = f"void {kind} m 0 0 5 .5 .5 .5 {s} 0"
    (layer,) = model_of(f"{text}\nm{SQUARE}", tmp_path).layers
    assert layer.deviates == polished
    made = mi.load_dict(bsdf(layer.deviating or layer.material))
    si = dr.zeros(mi.SurfaceInteraction3f, len(angles))
    t = mi.Float(np.radians(angles))
    si.wi = mi.Vector3f(dr.sin(t), 0, dr.cos(t))
    _, weight = made.sample(mi.BSDFContext(), si, mi.Float(0.5), mi.Point2f(0.5))
    given = seen(text, tmp_path, angles, "below")[:, 0]
    np.testing.assert_allclose(np.array(weight[0]), given, atol=1e-3)


@pytest.mark.parametrize(
    ("colour", "shape", "mirrors"),
    [
        (".5 .5 .5", SQUARE, True),
        (".5 .5 .5", "box", True),
        (".5 .5 .5", "column", False),
        (".5 .4 .5", SQUARE, False),
    ],
)
def test_faintly_mirroring_surfaces_are_mirrors_where_suns_have_images(
    colour, shape, mirrors, tmp_path
):
    """In few planes and grey; others keep Lambert's law, their colour, and a note with its size."""
    shapes = {
        "box": "\n!genbox m box 1 1 1\n",
        "column": "\n!genprism m c 8 0 0 1 0 2 1 2 2 1 3 0 3 -1 2 -1 1 -l 0 0 1\n",
    }
    text = f"void plastic m 0 0 5 {colour} .03 0" + shapes.get(shape, f"\nm{shape}")
    model = model_of(text, tmp_path)
    assert [layer.deviates for layer in model.layers] == [mirrors]
    assert "by 1 %" in model.notes[0]


@pytest.mark.parametrize(
    "shares", [".99 .99 .99 .05 0 .5 .5", "1 1 1 .3 0 1 1", ".98 .98 .98 .05 0 .5 .9"]
)
def test_trans_that_absorbs_little_sends_on_no_more_than_all(shares, tmp_path):
    """The mean of F beside the peak at normal incidence was above 1, and a traceback."""
    (layer,) = model_of(f"void trans m 0 0 7 {shares}\nm{SQUARE}", tmp_path).layers
    pane = layer.material
    assert isinstance(pane, DiffuserMaterial)
    total = pane.most_through + pane.reflectance
    assert 0.9 < total <= 1 + 1e-9


def test_a_mixture_of_two_sides_may_be_of_one_pane(tmp_path):
    glass = "void glass m 0 0 3 .96 .96 .96\n"
    (tmp_path / "mixed").mkdir()
    mixed = glass + "void mixfunc m 4 m m if(Rdot,1,0) . 0 0"
    assert material(mixed, tmp_path / "mixed") == material(glass, tmp_path)
