"""Files that the readers take: valid ones, and damage that knows how they are built.

Every strategy draws a suffix and bytes. The weather files of a year are changed in some of their
8760 rows; the others are built anew each time.
"""

from __future__ import annotations

import copy
import functools
import struct
from pathlib import Path

import numpy as np
import pandas as pd
import pvlib
from drcmitsuba_plugins.klems_basis import BASES
from hypothesis import strategies as st

from tests.hard.generated_cases import BOX, BOX_FACES, LAMELLAE, PRISM, WEA, xml
from tests.hard.mutations import NOISE, damaged, mutated, toml

HOURS = pd.date_range("2015-01-01", "2015-12-31 23:00", freq="h")
PVLIB = Path(pvlib.__file__).parent / "data"


wholes = st.integers(0, 4).map(lambda v: v < 3)
"""Whether a file is left as it should be: drawn first, as what is drawn late varies less."""


# Weather


@functools.cache
def epw() -> tuple[str, ...]:
    """Lines of an EPW."""
    head = ["LOCATION,Town,-,XXX,made,000000,46.25,6.13,1.0,416.0", "DESIGN CONDITIONS,0"]
    head += ["TYPICAL/EXTREME PERIODS,0", "GROUND TEMPERATURES,0", "HOLIDAYS/DAYLIGHT SAVINGS"]
    head += ["COMMENTS 1,none", "COMMENTS 2,", "DATA PERIODS,1,1,Data,Sunday,1/1,12/31"]
    rest = ",".join("0" * 19)
    rows = (
        f"1999,{h.month},{h.day},{h.hour + 1},60,?9?9,20.0,7.5,50,98100,0,0,300,120,100,50,{rest}"
        for h in HOURS
    )
    return (*head, *rows)


@functools.cache
def tmy3() -> tuple[str, ...]:
    """Lines of a TMY3."""
    columns = "Date (MM/DD/YYYY),Time (HH:MM),GHI (W/m^2),DNI (W/m^2),DHI (W/m^2),Dew-point (C)"
    rows = (f"{h:%m/%d}/1990,{h.hour + 1:02}:00,120,100,50,7.5" for h in HOURS)
    return ('723170,"TOWN, SOMEWHERE",NC,-5.5,36.100,-79.950,273', columns, *rows)


@functools.cache
def tmy2() -> tuple[str, ...]:
    """Lines of a TMY2."""
    return tuple((PVLIB / "12839.tm2").read_text(encoding="latin-1").split("\n"))


YEARS = {".epw": (epw, ","), ".csv": (tmy3, ","), ".tm2": (tmy2, None)}
FITTING = ("0", "1", "7.5", "120", "1000", "-0.5")


@st.composite
def weather_years(draw, suffix):
    """A year of hours with some of its fields, rows or lines changed."""
    base, comma = YEARS[suffix]
    lines = list(base())
    for _ in range(draw(st.sampled_from([0, 0, 1, 1, 1, 2]))):
        last = len(lines) - 1
        at = draw(st.integers(0, draw(st.sampled_from([min(9, last), last, last]))))
        how = draw(st.sampled_from(["fitting", "fitting", "fitting", "noise", "line", "cut"]))
        if how == "cut":
            lines = lines[: max(1, at)]
        elif how == "line":
            there = draw(st.sampled_from([at, at + 1, 3000]))
            lines[at:at] = draw(st.sampled_from([[], [""], [lines[at]], lines[there : there + 2]]))
            if draw(st.booleans()):
                del lines[at : at + draw(st.sampled_from([1, 24]))]
        elif comma is None:
            line, column = lines[at], draw(st.integers(0, 141))
            new = str(draw(st.integers(0, 9))) if how == "fitting" else draw(st.sampled_from(NOISE))
            lines[at] = line[:column] + new + line[column + 1 :]
        else:
            fields = lines[at].split(comma)
            column = draw(st.integers(0, len(fields) - 1))
            fields[column] = draw(st.sampled_from(FITTING if how == "fitting" else NOISE))
            lines[at] = comma.join(fields)
        lines = lines or [""]
    text = "\n".join(lines)
    ends = draw(st.sampled_from(["\n", "\n", "\r\n", "\r"]))
    return suffix, text.replace("\n", ends).encode("utf-8", "replace")


@st.composite
def weas(draw):
    """Radiance's WEA, of any stamps."""
    whole = draw(wholes)
    lines = WEA.split("\n")[:6]
    for _ in range(draw(st.integers(0, 2))):
        at = draw(st.integers(1, 4))
        number = draw(st.floats(-80, 80).map(lambda v: f"{v:.2f}"))
        lines[at] = f"{lines[at].split()[0]} {number}"
    step = draw(st.sampled_from([1.0, 0.5, 1 / 6]))
    first = draw(st.integers(0, 12)) + draw(st.sampled_from([0, 0.5]))
    for day in sorted(draw(st.sets(st.integers(1, 28), min_size=1, max_size=3))):
        for i in range(draw(st.integers(1, 6))):
            dni, dhi = draw(st.integers(0, 1000)), draw(st.integers(0, 500))
            lines.append(f"6 {day} {first + i * step:.3f} {dni} {dhi}")
    text = "\n".join(lines) + "\n"
    if whole:
        return ".wea", text.encode()
    return ".wea", draw(damaged(text))


# BSDF files

NAMES = ("Transmission Front", "Transmission Back", "Reflection Front", "Reflection Back")
HEADS = (
    "", '<?xml version="1.0" encoding="UTF-8"?>', '<?xml version="1.0" encoding="utf-16"?>',
    '<?xml version="1.0" encoding="latin-1"?>', '<!DOCTYPE w SYSTEM "file:///etc/passwd">',
    '<!DOCTYPE w [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>',
    '<!DOCTYPE w [<!ENTITY x SYSTEM "file:///dev/zero">]>', "<?xml?>", "<!--", "\x00", " \n text ",
    "<a>" * 3000,
)  # fmt: skip


@st.composite
def trees(draw, rank, depth=3):
    """Text of a tree: blocks of numbers and dark leaves, split where drawn."""
    values = st.sampled_from(["0", "0", "0.01", "0.05", "0.08", "1e-30", "1e-45"])
    split = st.integers(0, 2).map(lambda v: v == 0)

    def node(level):
        if level < depth and draw(st.just(True) if level == 0 else split):
            return "{" + "".join(node(level + 1) for _ in range(1 << rank)) + "}"
        if draw(st.integers(0, 9)) == 0:
            return "{" + " ".join([draw(values)] * (1 << rank)) + "}"
        return "{" + draw(values) + "}"

    kind = draw(st.sampled_from(["leaf", "tree", "grid"]))
    if kind == "leaf":
        return "{" + draw(st.sampled_from(["0", "0.1", "0.15"])) + "}"
    if kind == "grid":
        count = (1 << rank) ** draw(st.integers(1, 2))
        seed = draw(st.integers(0, 99))
        return (
            "{" + ", ".join(f"{v:.3g}" for v in np.random.default_rng(seed).random(count) / 8) + "}"
        )
    return node(0)


@st.composite
def matrices(draw, basis):
    """Text of a matrix over a Klems basis."""
    count = len(BASES[basis]) ** 2 + draw(st.sampled_from([0] * 12 + [-1, 1, 50]))
    scale = draw(st.sampled_from([0.0, 0.05, 0.1, 0.15]))
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    return " ".join(f"{v:.3g}" for v in scale * rng.random(max(count, 0)))


@st.composite
def bsdf_files(draw):
    """BSDF files of all kinds."""
    whole = draw(wholes)
    kinds = ["TensorTree4", "TensorTree4", "TensorTree3", "Columns", "Rows"]
    kind, basis = draw(st.sampled_from(kinds)), draw(st.sampled_from(list(BASES)[1:]))
    names = draw(st.lists(st.sampled_from(NAMES), min_size=1, max_size=3, unique=True))
    blocks = []
    for name in names:
        tree = trees(4, 2) if kind == "TensorTree4" else trees(3)
        text = draw(matrices(basis) if kind in ("Columns", "Rows") else tree)
        blocks.append((name, text))
        if draw(st.integers(0, 7)) == 0:
            blocks.append((name, text, draw(st.sampled_from(["CIE-u", "CIE-v", "CIE-X", "Solar"]))))
    odd = draw(st.integers(0, 15)) == 0
    text = xml(blocks, draw(st.sampled_from(["Octree", "", "TensorTree3"])) if odd else kind, basis)
    head = draw(st.sampled_from(["", "", "", "", "", "", "head"]))
    text = (draw(st.sampled_from(HEADS)) if head else "") + text
    if whole:
        return ".xml", text.encode("utf-16" if "utf-16" in head else "utf-8", "replace")
    return ".xml", draw(damaged(text))


@st.composite
def measurements(draw):
    """Goniophotometer text by pab-opto: up to six incidences."""
    whole = draw(wholes)
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    lines = ['#sample_name "film"', f"#format: theta phi {draw(st.sampled_from(['DSF', 'BSDF']))}"]
    lines.append(draw(st.sampled_from(["#upphi 90", "# remark", "#colorimetry: CIE-Y"])))
    incidences = [(0, 0), (40, 0), (40, 90), (60, 0), (40, 180), (30, 270)]
    for theta, phi in incidences[: draw(st.integers(2, 6))]:
        lines.append(f"#incident_angle {theta} {phi}")
        for _ in range(draw(st.sampled_from([60] * 9 + [3]))):
            out = 180 - 85 * np.sqrt(rng.random())
            lines.append(f"{out:.2f} {360 * rng.random():.2f} {rng.random() / 6:.4f}")
    text = "\n".join(lines)
    if whole:
        return ".txt", text.encode()
    return ".txt", draw(damaged(text))


# Recipes, meshes, time stamps

SLOTS = {
    "structure": {
        "kind": "slots", "n": 1.49, "period": 10, "thickness": 8, "slot": 0.5, "depth": 6,
    }
}  # fmt: skip
MESH = {
    "structure": {
        "kind": "mesh", "file": "box.obj", "period": [1.0, 1.0], "scale": 0.9,
        "material": {"type": "dielectric", "n": 1.5},
    }
}  # fmt: skip
GLASS = {"transmittance": 0.65, "exponent": 4.5, "reflectance": 0.1, "distance": 5.0}


@st.composite
def recipes(draw):
    """Recipes of the goniophotometer; box.obj lies beside them."""
    whole = draw(wholes)
    tree = copy.deepcopy(draw(st.sampled_from([LAMELLAE, PRISM, SLOTS, MESH])))
    tree["name"] = draw(st.text(st.characters(codec="utf-8", categories=["L", "N"]), max_size=9))
    if "n" in tree["structure"]:
        tree["structure"]["n"] = draw(st.floats(1.2, 2.0))
    if tree["structure"]["kind"] != "mesh" and draw(st.integers(0, 3)) == 0:
        tree["glass"] = dict(GLASS)
    if not whole and draw(st.booleans()):
        return ".toml", draw(damaged(toml(tree)))
    if not whole:
        tree = draw(mutated(tree))
    return ".toml", toml(tree).encode("utf-8", "replace")


def _ply(form, vertices, faces):
    head = f"ply\nformat {form} 1.0\nelement vertex {len(vertices)}\n"
    head += "".join(f"property float {c}\n" for c in "xyz")
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    if form == "ascii":
        body = "".join("{} {} {}\n".format(*v) for v in vertices)
        return head.encode() + (body + "".join("3 {} {} {}\n".format(*f) for f in faces)).encode()
    order = "<" if "little" in form else ">"
    body = b"".join(struct.pack(order + "3f", *v) for v in vertices)
    return head.encode() + body + b"".join(struct.pack(order + "B3i", 3, *f) for f in faces)


@st.composite
def meshes(draw):
    """Boxes as OBJ or PLY."""
    whole = draw(wholes)
    size = draw(st.floats(1e-3, 1e3))
    vertices = [tuple(size * c for c in v) for v in BOX]
    faces = [(a - 1, b - 1, c - 1) for a, b, c, _ in BOX_FACES]
    faces += [(a - 1, c - 1, d - 1) for a, _, c, d in BOX_FACES]
    form = draw(st.sampled_from(["obj", "ascii", "binary_little_endian", "binary_big_endian"]))
    if form == "obj":
        extra = draw(st.sampled_from(["", "vn 0 0 1\n", "usemtl x\n", "# text\n", "s off\no a\n"]))
        text = extra + "".join("v {} {} {}\n".format(*v) for v in vertices)
        how = draw(st.sampled_from(["f {} {} {}\n", "f {0}/1 {1}/2/3 {2}//4\n"]))
        raw = (text + "".join(how.format(*(i + 1 for i in f)) for f in faces)).encode()
    else:
        raw = _ply(form, vertices, faces)
    suffix = ".obj" if form == "obj" else ".ply"
    if whole:
        return suffix, raw
    if form in ("obj", "ascii"):
        return suffix, draw(damaged(raw.decode()))
    changes = ((b"8\n", b"-8\n"), (b"8\n", b"99999999999\n"), (b"12\n", b"4294967295\n"))
    changes += (
        (b"uchar int", b"uchar float"),
        (b"uchar int", b"double uint"),
        (b"float x", b"int x"),
    )
    changes += ((b"float x", b"float y"), (b"uchar", b"int"), (b"end_header", b"end"), (b"", b""))
    old, new = draw(st.sampled_from(changes))
    raw = raw.replace(old, new, 1) if old else raw
    at = draw(st.integers(0, len(raw)))
    return suffix, raw[:at] + draw(st.binary(max_size=9)) + raw[at + draw(st.integers(0, 9)) :]


@st.composite
def time_stamps(draw):
    """A file of time stamps."""
    whole = draw(wholes)
    times = draw(st.sets(st.datetimes(pd.Timestamp("2015-01-01"), pd.Timestamp("2015-12-31"))))
    form = draw(st.sampled_from(["%Y-%m-%dT%H:%M", "%Y-%m-%d %H:%M:%S"]))
    rows = sorted({f"{t:{form}}" for t in times}) or ["2015-03-21T10:00"]
    text = "\n".join(["time", *rows])
    if whole:
        return ".csv", text.encode()
    return ".csv", draw(damaged(text))
