"""The reader of BSDF files: Radiance's look-ups, what may vary in a file, and what is refused."""

import csv
import tracemalloc
from itertools import product

import numpy as np
import pytest
from drcmitsuba_plugins import braces, bsdf_file
from drcmitsuba_plugins.klems_basis import BASES, KlemsMatrix
from drcmitsuba_plugins.tensor import TensorTree, morton, to_direction, to_disk, to_square, unpack
from hypothesis import given, settings
from hypothesis import strategies as st

from drcmitsuba import bsdf
from drcmitsuba.runtime.errors import InputError
from tests import SHARED, skips

GOLDEN = SHARED / "reference" / "golden_bsdf_query_radiance.csv"
HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'
LAMBERTIAN = "{ 0.1 }"


def block(direction, numbers, *, basis="", wavelength="Visible"):
    return (
        f'<WavelengthData><Wavelength unit="Integral">{wavelength}</Wavelength>'
        f"<WavelengthDataBlock><WavelengthDataDirection>{direction}</WavelengthDataDirection>"
        f"{basis}<ScatteringData>{numbers}</ScatteringData></WavelengthDataBlock></WavelengthData>"
    )


def window(*blocks, structure="TensorTree4", name="film", head=HEAD):
    return (
        f'{head}<WindowElement xmlns="http://windows.lbl.gov"><Optical><Layer><Material>'
        f"<Name>{name}</Name><Manufacturer>maker</Manufacturer></Material><DataDefinition>"
        f"<IncidentDataStructure>{structure}</IncidentDataStructure></DataDefinition>"
        f"{''.join(blocks)}</Layer></Optical></WindowElement>"
    )


def angle_bases(column, row=None):
    row = row or column
    return f"<ColumnAngleBasis>{column}</ColumnAngleBasis><RowAngleBasis>{row}</RowAngleBasis>"


def back(numbers, **kinds):
    return window(block("Reflection Back", numbers), **kinds)


def klems(numbers, basis, structure="Columns"):
    return window(block("Reflection Back", numbers, basis=basis), structure=structure)


def words(numbers):
    return ", ".join(f"{v:.6g}" for v in np.ravel(numbers))


@pytest.fixture
def read(tmp_path):
    def from_text(text):
        path = tmp_path / "film.xml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return bsdf.read(path)

    return from_text


def unit(theta, phi):
    t, p = np.radians(np.asarray(theta, float)), np.radians(np.asarray(phi, float))
    return np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)


def random_directions(seed, count, side=1.0):
    return to_direction(*np.random.default_rng(seed).random((2, count)), side=side)


def golden_files():
    if not GOLDEN.exists():
        return []
    with GOLDEN.open(encoding="utf-8") as file:
        return sorted({row["file"] for row in csv.DictReader(file)})


@skips.needs(GOLDEN)
@pytest.mark.parametrize("name", golden_files())
def test_look_ups_are_radiances(name):
    with GOLDEN.open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["file"] == name]
    content = bsdf.read(SHARED / "data" / "bsdf" / name)

    def columns(kind, *keys):
        return np.array([[float(r[k]) for k in keys] for r in rows if r["kind"] == kind]).T

    theta, phi, value = columns("hemi_T", "theta_in_deg", "phi_in_deg", "value")
    assert len(value) >= 60
    np.testing.assert_allclose(content.hemispherical(unit(theta, phi))[0], value, 5e-4, 5e-7)
    keys = ("theta_in_deg", "phi_in_deg", "theta_out_deg", "phi_out_deg", "value")
    theta, phi, theta_out, phi_out, value = columns("query", *keys)
    assert len(value) >= 70
    got = content.query(unit(theta, phi), unit(theta_out, phi_out))
    np.testing.assert_allclose(got, value, 5e-4, 5e-7)  # Radiance adds noise of 1e-4


# ---- trees


def expanded(tree, depth):
    """Values of all finest cells of a depth, in Morton order."""
    start = tree.start << tree.rank * (depth - tree.depth)
    return tree.value[np.searchsorted(start, np.arange(1 << tree.rank * depth), "right") - 1]


@st.composite
def trees(draw, rank, depth):
    """A tree that is split where drawn, with a value in every leaf."""
    start, level = [], []

    def grow(code, at):
        if at < depth and draw(st.booleans() if at else st.just(True)):
            for child in range(1 << rank):
                grow((code << rank) + child, at + 1)
        else:
            start.append(code << rank * (depth - at))
            level.append(at)

    grow(0, 0)
    seed = draw(st.integers(0, 2**32 - 1))
    value = np.round(np.random.default_rng(seed).random(len(start)), 5)
    return TensorTree(rank, depth, np.array(start), np.array(level), value)


@pytest.mark.parametrize(("rank", "depth"), [(3, 3), (4, 2)])
def test_writing_and_reading_a_tree_changes_nothing(rank, depth):
    @settings(max_examples=25, deadline=None)
    @given(trees(rank, depth))
    def round_trip(tree):
        again = braces.read(braces.write(tree), rank)
        assert len(again) == len(tree)
        np.testing.assert_allclose(expanded(again, depth), expanded(tree, depth), rtol=1e-4)

    round_trip()


@settings(max_examples=25, deadline=None)
@given(trees(4, 2), st.integers(0, 99))
def test_reversing_exchanges_directions_and_twice_changes_nothing(tree, seed):
    a, b = random_directions(seed, 50), random_directions(seed + 100, 50, -1)
    np.testing.assert_array_equal(tree.reversed().values(b, a), tree.values(a, b))
    twice = tree.reversed().reversed()
    np.testing.assert_array_equal(twice.start, tree.start)
    np.testing.assert_array_equal(twice.value, tree.value)


@settings(max_examples=50, deadline=None)
@given(st.floats(1e-6, 1 - 1e-6), st.floats(1e-6, 1 - 1e-6))
def test_square_and_disk_are_inverse(s, t):
    np.testing.assert_allclose(to_square(*to_disk(s, t)), (s, t), atol=1e-9)


def test_the_map_to_the_square_keeps_areas():
    s, t = np.random.default_rng(1).random((2, 500))
    off_diagonal = (abs(s - t) > 0.01) & (abs(s + t - 1) > 0.01)
    s, t, h = s[off_diagonal], t[off_diagonal], 1e-6
    by_s = np.subtract(to_disk(s + h, t), to_disk(s - h, t)) / (2 * h)
    by_t = np.subtract(to_disk(s, t + h), to_disk(s, t - h)) / (2 * h)
    np.testing.assert_allclose(by_s[0] * by_t[1] - by_s[1] * by_t[0], np.pi, rtol=1e-5)


@pytest.mark.parametrize(("rank", "depth"), [(3, 4), (4, 3)])
def test_morton_codes_unpack(rank, depth):
    code = np.arange(1 << rank * depth)
    whole = unpack(code, rank, depth)
    np.testing.assert_array_equal(morton([(c + 0.5) / (1 << depth) for c in whole], depth), code)


def test_in_a_block_of_numbers_the_last_coordinate_runs_fastest():
    grid = np.arange(1.0, 17).reshape(2, 2, 2, 2)
    tree = braces.read("{" + words(grid) + "}", 4)
    for index in product((0, 1), repeat=4):
        code = morton([np.array(i / 2 + 0.25) for i in index], 1)
        assert expanded(tree, 1)[code] == grid[index]


def test_children_have_the_first_coordinate_in_their_lowest_bit(read):
    leaves = "\n".join(f"{{ {v} }}" for v in range(16))
    content = read(window(block("Transmission Front", "{\n" + leaves + "\n}")))
    tree = content.components["tb"]
    # Incident from −x −y: both incident coordinates ≥ ½; leaving to −x +y: only the last one is.
    got = content.query(np.array([[-0.3, -0.3, -0.9]]), np.array([[-0.3, 0.3, 0.9]]))
    assert got == [1 + 2 + 8]
    assert tree.depth == 1


def test_the_dead_half_of_an_isotropic_tree_counts_nowhere(read):
    live, dead = "{ 0.2 }", "{ 7 }"
    numbers = "{" + " ".join((live, dead) * 4) + "}"  # the first coordinate is the lowest bit
    content = read(window(block("Reflection Back", numbers), structure="TensorTree3"))
    incident = random_directions(1, 200)
    np.testing.assert_allclose(content.query(incident, random_directions(2, 200)), 0.2)
    np.testing.assert_allclose(content.hemispherical(incident)[1], 0.2 * np.pi)
    assert content.components["rf"].lambertian() == pytest.approx(0.2 * np.pi)


def test_an_isotropic_tree_turns_with_the_light(read):
    rng = np.random.default_rng(4)
    numbers = "{" + words(rng.random((8, 8, 8))) + "}"
    content = read(window(block("Transmission Back", numbers), structure="TensorTree3"))
    a, b = random_directions(5, 100), random_directions(6, 100, -1)
    c, s = np.cos(1.1), np.sin(1.1)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    same = np.isclose(content.query(a @ turn.T, b @ turn.T), content.query(a, b))
    assert same.mean() > 0.97  # rounding may carry single pairs over a border of cells


@pytest.mark.parametrize(
    ("direction", "incident", "outgoing"),
    [
        ("Transmission Front", -1, 1),
        ("Transmission Back", 1, -1),
        ("Reflection Front", -1, -1),
        ("Reflection Back", 1, 1),
    ],
)
def test_sides_are_named_as_window_does(read, direction, incident, outgoing):
    content = read(window(block(direction, LAMBERTIAN)))
    a, b = np.array([[0.1, 0.2, 0.9 * incident]]), np.array([[0.3, 0.1, 0.9 * outgoing]])
    assert content.query(a, b) == [0.1]
    assert content.query(-a, b) == [0.0]


def test_transmission_that_is_missing_follows_by_reciprocity(read):
    rng = np.random.default_rng(7)
    numbers = "{" + words(rng.random((4,) * 4)) + "}"
    content = read(window(block("Transmission Front", numbers)))
    a, b = random_directions(8, 200, -1), random_directions(9, 200)
    np.testing.assert_array_equal(content.query(b, a), content.query(a, b))
    outgoing = to_direction(
        *(g.ravel() for g in np.meshgrid(*[(np.arange(64) + 0.5) / 64] * 2)), -1
    )
    sums = [
        np.pi * content.query(np.broadcast_to(i, outgoing.shape), outgoing).mean() for i in b[:5]
    ]
    np.testing.assert_allclose(content.hemispherical(b[:5])[0], sums)


def test_the_order_of_blocks_does_not_matter(read):
    blocks = [
        block("Transmission Front", "{ 0.1 }"),
        block("Transmission Back", "{ 0.2 }"),
        block("Reflection Front", "{ 0.3 }"),
        block("Reflection Back", "{ 0.4 }"),
        block("Transmission Front", "{ 9 }", wavelength="Solar"),
        block("Absorptance Front", "{ 0.5 }"),
    ]
    for order in (blocks, blocks[::-1]):
        content = read(window(*order))
        values = {name: float(c.value[0]) for name, c in content.components.items()}
        assert values == {"tb": 0.1, "tf": 0.2, "rb": 0.3, "rf": 0.4}


def test_chromaticity_is_kept_beside_luminance(read):
    content = read(
        window(
            block("Transmission Front", "{ 0.1 }"),
            block("Transmission Front", "{ 0.21 }", wavelength="CIE-u"),
            block("Transmission Front", "{ 0.47 }", wavelength="CIE-v"),
        )
    )
    assert {k: float(c.value[0]) for k, c in content.colour["tb"].items()} == {"u": 0.21, "v": 0.47}
    assert float(content.components["tb"].value[0]) == 0.1


def test_text_before_the_declaration_is_passed_over(read):
    content = read(
        b"\n written by a program\n" + window(block("Reflection Back", LAMBERTIAN)).encode()
    )
    assert (content.name, content.manufacturer, content.kind) == ("film", "maker", "TensorTree4")


def test_noise_below_zero_counts_as_zero(read):
    content = read(window(block("Reflection Back", "{" + words([1.0] * 15 + [-5e-5]) + "}")))
    assert content.components["rf"].value.min() == 0


# ---- Klems


@pytest.mark.parametrize("basis", BASES.values(), ids=lambda b: b.name)
def test_patches_tile_the_hemisphere_and_hold_their_centres(basis):
    assert basis.projected_solid_angle.sum() == pytest.approx(np.pi)
    np.testing.assert_array_equal(basis.patch(*basis.centres.T), np.arange(len(basis)))
    x, y, z = basis.centres.T
    np.testing.assert_array_equal(basis.patch(-x, -y, z), basis.opposite)


@pytest.mark.parametrize(("name", "count"), [("Full", 145), ("Half", 73), ("Quarter", 41)])
def test_rows_are_the_transpose_of_columns(read, name, count):
    rng = np.random.default_rng(count)
    numbers = np.round(rng.random((count, count)), 4)
    basis = angle_bases(f"LBNL/Klems {name}")
    columns, rows = (
        read(window(block("Transmission Front", words(m), basis=basis), structure=structure))
        for m, structure in ((numbers, "Columns"), (numbers.T, "Rows"))
    )
    a, b = random_directions(1, 100, -1), random_directions(2, 100)
    np.testing.assert_array_equal(columns.query(a, b), rows.query(a, b))
    # A block of numbers is one outgoing patch; straight through has the same number.
    centre = BASES[f"LBNL/Klems {name}"].centres[7]
    assert columns.query(-centre, centre) == pytest.approx([numbers[7, 7]])
    other = BASES[f"LBNL/Klems {name}"].centres[5]
    assert columns.query(-centre, other) == pytest.approx([numbers[5, 7]])


def test_a_reversed_matrix_exchanges_directions_and_twice_changes_nothing():
    basis = BASES["LBNL/Klems Quarter"]
    matrix = KlemsMatrix(basis, basis, np.random.default_rng(3).random((41, 41)))
    a, b = random_directions(3, 300), random_directions(4, 300, -1)
    np.testing.assert_array_equal(matrix.reversed().values(b, a), matrix.values(a, b))
    np.testing.assert_array_equal(matrix.reversed().reversed().value, matrix.value)


# ---- what is refused

TENFOLD = [(f"&{a};", b) for a, b in zip("abcdefgh", "bcdefghi", strict=True)]
BOMB = (
    HEAD
    + '<!DOCTYPE w [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY {b} "{a * 10}">' for a, b in TENFOLD)
    + "]><WindowElement>&i;</WindowElement>"
)
EXTERNAL = (
    HEAD + '<!DOCTYPE w [<!ENTITY x SYSTEM "file:///etc/hostname">]><WindowElement>&x;'
    "</WindowElement>"
)
QUARTER = angle_bases("LBNL/Klems Quarter")
BAD = {
    "entity bomb": (BOMB, "entities"),
    "external entity": (EXTERNAL, "entities"),
    "document type": (HEAD + '<!DOCTYPE w SYSTEM "http://x/y.dtd"><w/>', "entities"),
    "empty": ("", "XML"),
    "binary": (bytes(range(256)) * 50, "XML"),
    "unknown encoding": ('<?xml version="1.0" encoding="klingon"?><w/>', "XML"),
    "truncated": (back(LAMBERTIAN)[:-40], "XML"),
    "other XML": (HEAD + "<html><body/></html>", "Layer"),
    "no data": (window(), "no visible data"),
    "no numbers": (back(" "), "no ScatteringData"),
    "structure": (back(LAMBERTIAN, structure="Octree"), "'Octree'"),
    "NaN": (back("{ nan }"), "'nan'"),
    "infinite": (back("{ 1e999 }"), "not finite"),
    "negative": (back("{" + "0.1 " * 15 + "-3}"), "-3"),
    "a number missing": (back("{" + "0.1 " * 15 + "}"), "15"),
    "a branch missing": (back("{" + "{ 0.1 }" * 15 + "}"), "15"),
    "a brace missing": (back("{" + "{ 0.1 }" * 16), "braces"),
    "a brace too many": (back(LAMBERTIAN + "}"), "braces"),
    "two trees": (back(LAMBERTIAN * 2), "braces"),
    "no braces": (back("0.1"), "braces"),
    "numbers beside branches": (back("{ 3" + "{ 0.1 }" * 16 + "}"), "outside the innermost"),
    "words": (back("{ see appendix }"), "'see'"),
    "two points": (back("{ 1.2.3 }"), "no number"),
    "deep braces": (back("{" * 50_000 + "1" + "}" * 50_000), "branches"),
    "no basis": (klems("1", ""), "AngleBasis"),
    "wrong basis": (klems("1", angle_bases("LBNL/Klems Tenth")), "'LBNL/Klems Tenth'"),
    "Klems numbers missing": (klems("0.1 " * 1680, QUARTER), "1680"),
    "Klems NaN": (klems("0.1 " * 1680 + "nan", QUARTER, "Rows"), "not finite"),
    "Klems negative": (klems("0.1 " * 1680 + "-1", QUARTER), "negative"),
    "Klems words": (klems("0.1 about", QUARTER), "'about'"),
}


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD)
def test_what_is_wrong_gives_one_line(read, text, message):
    with pytest.raises(InputError) as error:
        read(text)
    line = str(error.value)
    assert "film.xml" in line
    assert message in line
    assert "\n" not in line
    assert len(line) < 400


def test_an_entity_bomb_takes_no_memory(read):
    tracemalloc.start()
    with pytest.raises(InputError):
        read(BOMB)
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


def test_deep_elements_are_refused_and_do_no_harm(read):
    with pytest.raises(InputError, match="Layer"):
        read(HEAD + "<a>" * 20_000 + "</a>" * 20_000)


def test_a_file_that_is_too_large_is_not_read(read, monkeypatch):
    monkeypatch.setattr(bsdf_file, "MAX_BYTES", 100)
    with pytest.raises(InputError, match="size"):
        read(window(block("Reflection Back", LAMBERTIAN)))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.xml"):
        bsdf.read(tmp_path / "nowhere.xml")
