"""`check` says what is known of films made for the purpose, and the pictures show it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from drcmitsuba_plugins.bsdf_file import BsdfFile
from drcmitsuba_plugins.klems_basis import BASES, KlemsMatrix
from drcmitsuba_plugins.tensor import TensorTree, to_direction
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import QuadMesh
from matplotlib.patches import Wedge

from drcmitsuba import InputError, bsdf, load_case
from drcmitsuba.bsdf import balance, lobes
from drcmitsuba.bsdf.check import check
from drcmitsuba.bsdf.pictures import figures
from tests import SHARED, skips

N = 16  # cells along an axis of the films below
CELL = np.pi / N**2
KLEMS = BASES["LBNL/Klems Full"]
REFUSED = SHARED / "data/bsdf/radiance_testBSDF_ref.xml"


def film(kind="TensorTree4", name="film", notes=(), **components):
    return BsdfFile("folder/film.xml", name, "", kind, components, notes=notes)


def lambertian(albedo):
    return TensorTree.constant(albedo / np.pi)


def sending(where, transmittance=0.6):
    """Tree that sends the light of incident cell (s, t) to the outgoing cell `where(s, t)`."""
    grid = np.zeros((N,) * 4)
    for s, t in np.ndindex(N, N):
        grid[(s, t, *where(s, t))] = transmittance / CELL
    return TensorTree.of_grid(grid)


def window(s, t):
    return s, t


def redirecting(s, t):
    """Turn up what arrives from above (the tree's lower half: −incident), pass the rest."""
    return s, max(t, N - 1 - t)


def downward(s, t):
    return s, min(t, N - 1 - t)


def klems(transmittance=0.8):
    value = np.diag(transmittance / KLEMS.projected_solid_angle)
    return KlemsMatrix(KLEMS, KLEMS, value)


def test_a_lambertian_film_is_even_in_every_respect():
    report = check(film(tb=lambertian(0.5), tf=lambertian(0.5), rb=lambertian(0.3)))
    for curve in report.curves:
        assert curve.transmittance == pytest.approx([0.5] * 18)
    assert [e.reflectance for e in report.energy] == pytest.approx([0.3, 0])
    assert [s.upward for s in report.sunlight] == pytest.approx([0.5] * 8)
    assert [w.half_light for w in report.widths] == pytest.approx([90] * 4, abs=0.5)
    assert report.lambertian["tb"] == pytest.approx(0.5)
    assert report.reciprocity["transmission"] == pytest.approx(0, abs=1e-12)
    assert (report.model, report.hint, report.verdict) == ("any", "", "ok")
    assert not report.straight.stands_out
    assert report.notes == ("reflection into the room is missing: taken as 0",)


def test_a_redirecting_film_sends_the_sun_up():
    report = check(film(tb=sending(redirecting, 0.4)))
    assert [s.upward for s in report.sunlight] == pytest.approx([1] * 8)
    assert [s.transmittance for s in report.sunlight] == pytest.approx([0.4] * 8)
    assert all(w.toward == pytest.approx(w.elevation, abs=w.resolution) for w in report.widths)
    assert report.mounting["as the file says"] == pytest.approx(0.4)
    assert report.hint == ""
    assert report.model == "geometry"  # no peak is wider than its cell
    assert "transmission from the room is missing: taken by reciprocity" in report.notes


@pytest.mark.parametrize(
    ("component", "where", "words"),
    [("tb", downward, "upside down"), ("tf", redirecting, "front and back exchanged")],
)
def test_a_film_that_is_measured_another_way_round_is_hinted_at(component, where, words):
    other = {"tb": "tf", "tf": "tb"}[component]
    report = check(film(**{component: sending(where), other: lambertian(0.0)}))
    assert f"mounted {words}" in report.hint
    assert report.hint.startswith("hint")


def test_a_window_is_a_view_and_needs_no_geometry():
    report = check(film(tb=sending(window)))
    assert report.straight.stands_out
    assert report.straight.share == pytest.approx(1)
    assert report.straight.normal == pytest.approx(0.6)
    assert report.straight.ratio is None  # all around is dark
    assert report.model == "tensor_tree"
    assert all(w.toward == pytest.approx(-w.elevation, abs=w.resolution) for w in report.widths)


def test_half_a_window_tells_how_much_its_peak_stands_out():
    tree = sending(window, 0.3)
    report = check(film(tb=replace(tree, value=tree.value + 0.3 / np.pi)))
    assert report.straight.share == pytest.approx(0.5)
    assert report.straight.ratio == pytest.approx(1 + N**2)


@pytest.mark.parametrize("kind", ["tree", "klems"])
def test_a_peak_of_one_cell_is_as_wide_as_the_cell(kind):
    report = check(film(tb=sending(window)) if kind == "tree" else film("Klems", tb=klems()))
    assert report.widths
    for w in report.widths:
        assert w.half_maximum == pytest.approx(w.resolution, rel=0.08)
        assert w.share == pytest.approx(1)
        assert not w.is_resolved


def test_a_wide_peak_is_resolved_and_needs_no_geometry():
    u = (np.arange(N) + 0.5) / N
    x, y, _ = to_direction(*np.meshgrid(u, u, indexing="ij")).T  # transposed twice
    apart = (x.T[:, :, None, None] - x.T) ** 2 + (y.T[:, :, None, None] - y.T) ** 2
    tree = TensorTree.of_grid(np.exp(-apart / 0.2) * 0.5)
    report = check(film(tb=tree))
    assert all(w.is_resolved for w in report.widths)
    assert report.model == "tensor_tree"
    assert not report.straight.stands_out


def test_a_klems_file_is_simulated_as_one():
    report = check(film("Klems", tb=klems()))
    assert report.model == "klems"
    assert report.straight.normal == pytest.approx(0.8)
    assert report.energy[0].transmittance == pytest.approx(0.8)


@pytest.mark.parametrize(
    ("excess", "verdict"), [(1.0, "ok"), (1.03, "scaled"), (1.06, "refused"), (90.0, "refused")]
)
def test_energy_above_one_is_seen_where_it_is(excess, verdict):
    grid = np.full((N,) * 4, 0.5 / np.pi)
    grid[3, 12] = excess / np.pi - 0.1 / np.pi
    report = check(film(tb=TensorTree.of_grid(grid), rb=lambertian(0.1)))
    outside, room = report.energy
    assert outside.largest == pytest.approx(excess)
    assert outside.verdict == report.verdict == verdict
    assert room.verdict == "ok"
    there = to_direction(3.5 / N, 12.5 / N) * [-1, -1, 1]  # the tree's square is −incident
    assert outside.theta == pytest.approx(np.degrees(np.arccos(there[2])))
    assert outside.phi == pytest.approx(np.degrees(np.arctan2(there[1], there[0])) % 360)
    assert (report.model == "none") == (verdict == "refused")


@skips.needs(REFUSED)
def test_radiances_broken_file_is_refused():
    report = check(bsdf.read(REFUSED))
    assert report.energy[1].largest == pytest.approx(87.51, abs=0.01)
    assert report.verdict == "refused"


def test_reciprocity_is_measured_against_the_reverse():
    rng = np.random.default_rng(2)
    tree = TensorTree.of_grid(rng.random((4,) * 4))
    other = tree.reversed()
    twice = replace(other, value=other.value * 3)
    assert balance.reciprocity(film(tb=tree, tf=other))["transmission"] == 0
    asymmetry = balance.reciprocity(film(tb=tree, tf=twice))["transmission"]
    assert asymmetry == pytest.approx(2 / 2)  # |1 − 3| against their mean
    # One leaf of the coarse tree against many of the fine one.
    coarse = TensorTree.constant(0.5)
    asymmetry = balance.reciprocity(film(tb=tree, tf=coarse))["transmission"]
    value = tree.value
    assert asymmetry == pytest.approx(np.abs(value - 0.5).sum() / (value + 0.5).sum() * 2)
    lacking = balance.reciprocity(film(tb=tree))
    assert lacking == {"transmission": None, "rb": None, "rf": None}


def test_reciprocity_of_matrices_and_of_isotropic_trees():
    symmetric = klems()
    wrong = replace(symmetric, value=np.roll(symmetric.value, 20, axis=0))
    for matrix, error in ((symmetric, 0), (wrong, 2)):
        asymmetry = balance.reciprocity(film("Klems", rb=matrix))["rb"]
        assert asymmetry == pytest.approx(error, abs=1e-12)
    grid = np.zeros((8, 8, 8))
    grid[:] = np.where(np.arange(8) < 4, 1.0, 2.0)[:, None, None]  # the radius, of which half lives
    grid[:2] = 3.0
    asymmetry = balance.reciprocity(film("TensorTree3", rf=TensorTree.of_grid(grid)))["rf"]
    # f is 1 for r < ½ and 3 beyond; half of a quarter and three quarters of the light go across.
    assert asymmetry == pytest.approx(2 * 2 * 0.25 * 0.75 / (0.25 + 3 * 0.75), rel=0.05)


def test_noise_of_cells_is_no_lack_of_reciprocity():
    """A fine tree with noise of 30 % a cell, against one whose reverse is a fifth brighter."""
    rng = np.random.default_rng(3)
    tree = TensorTree.of_grid(1 + 0.1 * rng.random((16,) * 4))
    noisy = tree.reversed()
    noisy = replace(noisy, value=noisy.value * (1 + 0.3 * rng.standard_normal(len(noisy))))
    assert balance.reciprocity(film(tb=tree, tf=noisy))["transmission"] > 0.2
    assert balance.one_way(film(tb=tree, tf=noisy))["transmission"] < 0.03
    brighter = replace(noisy, value=noisy.value * 1.2)
    error = balance.one_way(film(tb=tree, tf=brighter))["transmission"]
    assert error == pytest.approx(0.2 / 1.1, rel=0.05)
    # A constant against the fine tree: their depths differ.
    error = balance.one_way(film(tb=tree, tf=TensorTree.constant(1.05)))["transmission"]
    assert error < 0.01
    assert balance.one_way(film(tb=tree)) == {}


def test_one_way_errors_of_matrices_and_isotropic_trees():
    matrix = KlemsMatrix(KLEMS, KLEMS, np.full((145, 145), 0.3))
    uneven = replace(matrix, value=matrix.value * np.where(np.arange(145) < 41, 2.0, 1.0))
    share = matrix.incident.projected_solid_angle
    share = share[:41].sum() / share.sum()
    # T is 2 on the inner patches and 1 elsewhere; T' is 1 + their share everywhere.
    for one, error in ((matrix, 0), (uneven, 2 * share * (1 - share) / (1 + share))):
        assert balance.one_way(film("Klems", rb=one))["rb"] == pytest.approx(error, rel=0.02)
    grid = np.full((8, 8, 8), 0.1)
    even = film("TensorTree3", rf=TensorTree.of_grid(grid))
    assert balance.one_way(even)["rf"] == pytest.approx(0, abs=1e-12)


def test_isotropic_files_have_one_curve_a_side_and_true_averages():
    grid = np.full((16, 16, 16), 0.4 / np.pi)
    grid[8:] = 99  # dead
    grid[:4] = 0.2 / np.pi  # r > ½: three quarters of diffuse light
    report = check(film("TensorTree3", tb=TensorTree.of_grid(grid)))
    assert [c.plane for c in report.curves] == ["any", "any"]
    assert report.energy[0].transmittance == pytest.approx(0.25 * 0.4 + 0.75 * 0.2)
    assert report.energy[0].largest == pytest.approx(0.4)
    assert report.energy[1].transmittance == pytest.approx(0.25, rel=0.02)  # by reciprocity


def test_a_report_is_plain_data_a_table_and_safe_html():
    report = check(film(name="<b>film</b>", tb=sending(window), rb=lambertian(0.1)))
    data = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    assert data["verdict"] == "ok"
    assert data["sunlight"][0]["elevation"] == 10
    assert len(str(report).splitlines()) == len(report.rows())
    assert "&lt;b&gt;film" in report._repr_html_()


def test_a_path_is_checked_like_the_file_that_it_leads_to():
    path = load_case("prism/as_bsdf").materials["panel"].file
    assert check(str(path)) == check(path) == check(bsdf.read(path))
    with pytest.raises(InputError, match="No such file"):
        check("missing.xml")


def test_klems_curves_have_their_points_at_the_centres_of_rings():
    report = check(film("Klems", tb=klems()))
    assert report.curves[0].theta == (0, 10, 20, 30, 40, 50, 60, 70, 82.5)
    assert [w.elevation for w in report.widths] == [10, 30, 40, 60]
    value = klems().value * np.arange(1, 146) / 145  # every incident patch another transmittance
    curve = check(film("Klems", tb=replace(klems(), value=value))).curves[0]
    first = KLEMS.first + np.array(KLEMS.counts) * 3 // 4 % KLEMS.counts  # from above is −y inward
    assert curve.transmittance == pytest.approx(0.8 * (first + 1) / 145)


def test_between_cells_the_mean_of_both_is_taken():
    tree = sending(window)
    on_axis, beside = lobes.sun(40.0), lobes.sun(40.0, 5.0)
    assert len(lobes.cells_at(tree, on_axis)) == 2
    assert len(lobes.cells_at(tree, beside)) == 1
    assert len(lobes.cells_at(tree, lobes.sun(0.0))) == 4
    value = lobes.lobe(tree, on_axis, 1.0, 128).value.reshape(128, 128)
    np.testing.assert_array_equal(value, value[::-1])  # left as right
    one = lobes.lobe(tree, on_axis, 1.0, 128, one_cell=True)
    assert one.value.max() == pytest.approx(2 * value.max())
    assert len(lobes.cells_at(klems(), lobes.sun(45.0))) == 2
    assert len(lobes.cells_at(klems(), lobes.sun(40.0))) == 1


def test_a_film_that_transmits_nothing_is_no_error():
    for file in (film(rf=lambertian(0.5)), film(tb=lambertian(0.0))):
        report = check(file)
        assert report.widths == ()
        assert report.model == "any"
        assert len(figures(file, report)) == 3


@pytest.mark.parametrize(
    ("elevation", "azimuth", "direction"),
    [(0, 0, [0, 0, -1]), (90, 0, [0, 1, 0]), (0, 90, [1, 0, 0]), (30, 0, [0, 0.5, -(0.75**0.5)])],
)
def test_the_sun_stands_outside_and_clockwise_is_right(elevation, azimuth, direction):
    np.testing.assert_allclose(lobes.sun(elevation, azimuth), direction, atol=1e-12)


def test_cones_and_solid_angles():
    assert lobes.cone_width(2 * np.pi) == pytest.approx(180)
    assert lobes.cone_width(np.pi * np.radians(0.25) ** 2) == pytest.approx(0.5, rel=1e-3)


# ---- pictures


@pytest.fixture(scope="module")
def drawn():
    file = film(tb=sending(redirecting), rb=lambertian(0.2))
    drawings = figures(file, check(file), sun=(40.0, -25.0))
    for figure in drawings.values():
        FigureCanvasAgg(figure).draw()
    return drawings


def texts(figure):
    """All texts but the labels of ticks."""
    artists = [*figure.texts, *(t for legend in figure.legends for t in legend.get_texts())]
    for ax in figure.axes:
        artists += [*ax.texts, ax.title, *(c for c in ax.get_children() if c is ax._left_title)]
        artists += [ax.xaxis.label, ax.yaxis.label] if ax.axison else []
    return [t for t in artists if t.get_text().strip()]


def test_the_maps_show_the_value_of_every_cell(drawn):
    figure = drawn["lobes.png"]
    transmitted, reflected = (ax.findobj(QuadMesh)[0] for ax in figure.axes[:2])
    assert transmitted.get_array().max() == pytest.approx(0.6 / CELL)
    assert np.count_nonzero(transmitted.get_array() > 1) == (128 // N) ** 2  # one cell of the tree
    np.testing.assert_allclose(reflected.get_array(), 0.2 / np.pi)
    x, y = transmitted.get_coordinates()[:-1, :-1].reshape(-1, 2)[transmitted.get_array().argmax()]
    assert x > 0.2  # the sun stands to the left, its light goes right
    assert y > 0.4  # and up
    shown = " ".join(t.get_text() for t in texts(figure))
    assert "60.0 % up, 0.0 % down" in shown
    assert "10.0 % up, 10.0 % down" in shown
    assert "25° to the left" in shown


def test_the_areas_of_the_wedges_are_the_shares_of_the_light(drawn):
    wedges = [w for w in drawn["section.png"].axes[0].patches if isinstance(w, Wedge)]
    assert len(wedges) == 2 * 36
    right = np.array([np.cos(np.radians(w.theta1 + 2.5)) > 0 for w in wedges])
    area = np.array([w.r**2 for w in wedges])
    assert area[right].sum() / area[~right].sum() == pytest.approx(0.6 / 0.2, rel=1e-3)
    upward = np.array([np.sin(np.radians(w.theta1 + 2.5)) > 0 for w in wedges])
    assert area[right & ~upward].sum() == 0


def test_the_curves_are_those_of_the_report(drawn):
    lines = drawn["curves.png"].axes[0].get_lines()
    drawn_values = {round(float(line.get_ydata()[0]), 6) for line in lines}
    assert drawn_values == {60.0, 20.0}


def test_no_text_lies_on_another_or_beyond_the_sheet(drawn):
    for name, figure in drawn.items():
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        boxes = [(t.get_text(), t.get_window_extent()) for t in texts(figure)]
        page = figure.bbox
        for i, (text, box) in enumerate(boxes):
            assert page.x0 <= box.x0, (name, text)
            assert box.x1 <= page.x1, (name, text)
            for other, at in boxes[:i]:
                inner = (
                    min(box.x1, at.x1) - max(box.x0, at.x0),
                    min(box.y1, at.y1) - max(box.y0, at.y0),
                )
                assert min(inner) < 2, (name, text, other)


def test_a_name_is_no_formula_and_takes_one_line():
    file = film(name="100$ ^{ film\n" + "long " * 40, tb=lambertian(0.5))
    report = check(file)
    assert all("\n" not in text for _, text in report.rows())
    for figure in figures(file, report).values():
        FigureCanvasAgg(figure).draw()
        title = figure.texts[0]
        assert title.get_text().startswith("100$ ^{ film long")
        assert title.get_window_extent().x1 < figure.bbox.x1


def test_pictures_say_where_cells_show(drawn):
    assert any("plateaus" in t.get_text() for t in drawn["curves.png"].texts)
    assert not any("mean is shown" in t.get_text() for t in drawn["lobes.png"].texts)
    file = film("Klems", tb=klems())
    drawings = figures(file, check(file))
    assert any("mean is shown" in t.get_text() for t in drawings["lobes.png"].texts)
    assert any("rings' centres" in t.get_text() for t in drawings["curves.png"].texts)


def test_what_is_not_in_the_file_is_said(drawn):
    file = film(tb=sending(window))
    drawings = figures(file, check(file))
    for name in ("lobes.png", "section.png"):
        assert any("not in the file" in t.get_text() for t in texts(drawings[name]))
    assert not any("not in the file" in t.get_text() for t in texts(drawn["lobes.png"]))
