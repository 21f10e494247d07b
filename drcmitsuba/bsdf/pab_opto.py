"""Reader of goniophotometer text by pab-opto (program Mountain), the input of `pabopto2bsdf`.

A file has a header of lines that begin with #, then lines `theta phi value`::

    #sample_name "prism film"
    #format: theta phi DSF
    #incident_angle 30 90
    #upphi 90
    0.5 12.0 0.0231

Incident and outgoing directions have the same angles [deg]: theta 0 … 180 from the normal of the
sample's front, phi counter-clockwise as seen from the front. `format` is DSF (f · cos θ) or one of
BSDF, BRDF and BTDF (f, in 1/sr). `#intheta` and `#inphi` may replace `#incident_angle`. `#upphi` is
the phi of the sample's top (default 0). Lines of `#colorimetry: CIE-XYZ` hold X, Y, Z; Y is read.

References
----------
.. [1] Radiance, manual page pabopto2bsdf(1).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drcmitsuba.bsdf.lobes import directions
from drcmitsuba.runtime.errors import InputError

LARGEST = 1e30
"""Largest number, whose square is still finite; f of the sharpest mirror is below 1e9 [1/sr]."""
MAX_BYTES = 1 << 28
"""Largest size of all files together [byte]."""
GRAZING = 88.0
"""Largest outgoing angle from the normal [deg]; beyond it a small cosine magnifies noise."""
NOISE = 0.01
"""Negative values down to −NOISE · the largest value are noise and count as 0."""

QUANTITIES = ("dsf", "bsdf", "brdf", "btdf")
"""Quantities that `format` may name."""
ANGLES = {"upphi": "up", "inphi": "phi", "intheta": "theta"}
"""Keys of one angle, and the field of the header that holds it."""


@dataclass(frozen=True)
class Measurement:
    """Scattered light for one direction of incidence."""

    source: str
    name: str
    """Path of the file, and the sample's name."""
    incident: np.ndarray
    """Direction away from the surface, +z the sample's front, +y its top, shape (3,)."""
    outgoing: np.ndarray
    """Directions in which the light leaves, shape (n, 3)."""
    value: np.ndarray
    """f [1/sr] without the cosine, shape (n,)."""


@dataclass(frozen=True)
class _Header:
    name: str = ""
    quantity: str = ""
    theta: float | None = None
    phi: float | None = None
    up: float = 0.0
    columns: int = 3


def read(paths: Iterable[str | Path]) -> list[Measurement]:
    """Read measurements in the order of the files; a file may hold several, each with its header.

    A file that cannot be read or has no measurement, and a wrong line, raise InputError.
    """
    measurements: list[Measurement] = []
    left = MAX_BYTES
    for path in map(Path, paths):
        try:
            if not path.is_file():  # a device would never end
                got = "no plain file" if path.exists() else "No such file or directory"
                raise InputError(path, "file", got, "name a measurement file")
            left -= path.stat().st_size
            if left < 0:
                got = f"more than {MAX_BYTES >> 20} MB with this file"
                raise InputError(path, "size", got, "give fewer points or incidences")
            text = path.read_bytes().decode("utf-8", "replace")
        except OSError as error:
            got = str(error.strerror)
            raise InputError(path, "file", got, "name a measurement file") from None
        measurements += _blocks(path, text)
    return measurements


def _blocks(path: Path, text: str) -> Iterator[Measurement]:
    """Measurements of one file: a header that follows numbers begins the next one."""
    header, count = _Header(), 0
    rows: list[list[float]] = []
    lines: list[int] = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        if words[0].startswith("#"):
            changed = _header(path, number, line, header)
            if changed is None:
                continue
            if rows:
                yield _measurement(path, header, rows, lines)
                count += 1
                rows, lines = [], []
                # Each measurement names its own incidence; the rest of the header stays.
                changed = _header(path, number, line, replace(header, theta=None, phi=None))
            header = changed or header
            continue
        rows.append(_numbers(path, number, words, header.columns))
        lines.append(number)
    if not rows and not count:
        raise InputError(path, "data", "no measured values", "give lines of theta, phi and value")
    if rows:
        yield _measurement(path, header, rows, lines)


def _header(path: Path, number: int, line: str, header: _Header) -> _Header | None:
    """Header with the value of a line; None for a line with no known key."""
    match = re.match(r"\s*#\s*(\w+)\s*:?\s*(.*)", line)
    key, rest = (match[1].lower(), match[2].strip()) if match else ("", "")
    where = f"line {number}: {key}"
    if key == "sample_name":
        shown = "".join(c for c in rest if c.isprintable())
        return replace(header, name=shown.strip('"')[:200])
    if key == "format":
        words = rest.lower().split()[:3]
        if words not in [["theta", "phi", quantity] for quantity in QUANTITIES]:
            remedy = "give theta phi DSF, BSDF, BRDF or BTDF"
            raise InputError(path, where, repr(rest[:40]), remedy)
        return replace(header, quantity=words[2])
    if key == "colorimetry":
        if rest.upper() not in ("CIE-Y", "CIE-XYZ"):
            raise InputError(path, where, repr(rest[:40]), "give CIE-Y or CIE-XYZ")
        return replace(header, columns=5 if rest.upper() == "CIE-XYZ" else 3)
    if key in ANGLES:
        angle: dict[str, Any] = {ANGLES[key]: _angles(path, number, key, rest, 1)[0]}
        return replace(header, **angle)
    if key == "incident_angle":
        theta, phi = _angles(path, number, key, rest, 2)
        return replace(header, theta=theta, phi=phi)
    return None


def _angles(path: Path, number: int, key: str, rest: str, count: int) -> list[float]:
    """The first `count` angles [deg] of a header line; the rest is a remark."""
    angles = _numbers(path, number, rest.split()[:count], count)
    if key in ("intheta", "incident_angle") and not 0 <= angles[0] <= 180:
        got = f"{angles[0]:g}°"
        raise InputError(path, f"line {number}: {key}", got, "give theta from 0 to 180°")
    return angles


def _numbers(path: Path, number: int, words: list[str], count: int) -> list[float]:
    """The `count` numbers of a line, all finite and at most `LARGEST`."""
    where = f"line {number}"
    if len(words) != count:
        raise InputError(path, where, f"{len(words)} numbers", f"give {count}")
    try:
        values = [float(word) for word in words]
    except ValueError:
        raise InputError(path, where, repr(" ".join(words)[:40]), "give numbers") from None
    if not all(abs(value) <= LARGEST for value in values):
        remedy = f"give finite numbers of at most {LARGEST:g}"
        raise InputError(path, where, repr(" ".join(words)[:40]), remedy)
    return values


def _measurement(
    path: Path, header: _Header, rows: list[list[float]], lines: list[int]
) -> Measurement:
    where = f"lines {lines[0]}–{lines[-1]}"
    if not header.quantity:
        raise InputError(path, where, "no #format", "give #format: theta phi DSF or BSDF")
    if header.theta is None or header.phi is None:
        raise InputError(path, where, "no #incident_angle", "give its theta and phi")
    data = np.array(rows)
    theta, phi, value = data[:, 0], data[:, 1], data[:, 3 if header.columns == 5 else 2]
    for bad, what, remedy in (
        ((theta < 0) | (theta > 180), "theta", "give theta from 0 to 180°"),
        (value < -NOISE * max(value.max(), 0), "value", "a BSDF is nowhere negative"),
    ):
        if bad.any():
            at = int(bad.argmax())
            column = theta if what == "theta" else value
            raise InputError(path, f"line {lines[at]}: {what}", f"{column[at]:g}", remedy)
    turn = 90 - header.up
    outgoing = directions(theta, phi + turn)
    cosine = np.abs(outgoing[:, 2])
    used = cosine > np.cos(np.radians(GRAZING))
    value = np.maximum(value[used], 0)
    if header.quantity == "dsf":
        value = value / cosine[used]
    incident = directions(np.array(header.theta), np.array(header.phi + turn))
    if abs(incident[2]) < np.cos(np.radians(89.5)):
        got = f"light arrives at {header.theta:g}°"
        raise InputError(path, where, got, "give an incidence that meets the surface")
    return Measurement(str(path), header.name, incident, outgoing[used], value)
