"""Header of a Radiance picture: lines of text up to an empty one, then the resolution."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drcmitsuba.picture.picture import RADIANCE, Picture, Primaries, refuse_size, to_xyz
from drcmitsuba.picture.view import PictureView, from_options
from drcmitsuba.runtime.errors import InputError

LONGEST = 1 << 20
"""Largest size of a header [byte]."""
RGBE, XYZE = "32-bit_rle_rgbe", "32-bit_rle_xyze"
_GAP = re.compile(rb"\r?\n\r?\n")
"""End of a header; files that passed through a mail or an editor end lines with CR LF."""
_PROGRAMS = ("rpict", "rview", "rvu", "rpiece", "pinterp")
"""Programs whose command lines state the view of a picture."""
_NUMBERS = {"p": 3, "d": 3, "u": 3, "h": 1, "v": 1, "s": 1, "l": 1}
"""Numbers of values behind the options `-vp`, `-vd` …"""
_RESOLUTION = re.compile(r"([+-])([XY])\s+(\d{1,9})\s+([+-])([XY])\s+(\d{1,9})\s*")


@dataclass(frozen=True)
class HdrHeader:
    """Statements of a header; those of earlier programs, which a tab indents, do not count."""

    form: str
    """`32-bit_rle_rgbe` or `32-bit_rle_xyze`."""
    view: PictureView | None
    """View by the `VIEW=` lines, or by the command line of the program that made the picture."""
    exposure: float
    """Product of all EXPOSURE lines [–]."""
    correction: np.ndarray
    """Product of all COLORCORR lines by channel [–], shape (3,)."""
    primaries: Primaries
    captured: str
    resolution: tuple[str, str, int, str, str, int]
    """Sign, axis and number of scanlines, then sign, axis and number of their pixels."""
    end: int
    """Place of the first pixel in the file [byte]."""

    @property
    def scanlines(self) -> int:
        """Number of scanlines."""
        return self.resolution[2]

    @property
    def width(self) -> int:
        """Number of pixels of a scanline."""
        return self.resolution[5]

    def upright(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels (row, column, …) from the top left, of those (scanline, pixel, …) of the file."""
        slow, axis, _, fast, _, _ = self.resolution
        if axis == "X":
            pixels, slow, fast = pixels.swapaxes(0, 1), fast, slow
        rows = slice(None) if slow == "-" else slice(None, None, -1)
        columns = slice(None) if fast == "+" else slice(None, None, -1)
        return pixels[rows, columns]


def read(raw: bytes, file: Path) -> HdrHeader:
    """Read the header of a picture.

    Parameters
    ----------
    raw : bytes
        The file, or as much of it as holds the header.
    file : Path
        Its path, for messages.

    Raises
    ------
    InputError
        The header breaks off, a value is unfit, or the picture would not fit in memory.
    """
    gap = _GAP.search(raw, 0, LONGEST)
    last = -1 if gap is None else raw.find(b"\n", gap.end(), gap.end() + 128)
    if not raw.startswith(b"#?") or gap is None or last < 0:
        raise InputError(file, "header", "no picture of Radiance", "give a whole .hdr file")
    lines = raw[: gap.start()].decode("utf-8", "replace").replace("\r\n", "\n").split("\n")
    resolution = _resolution(raw[gap.end() : last].decode("latin-1").rstrip("\r"), file)
    refuse_size(file, resolution[5], resolution[2])
    form, captured, views = RGBE, "", []
    exposure, correction, primaries = 1.0, np.ones(3), RADIANCE
    view_line = 1
    for number, line in enumerate(lines, 1):
        key, equals, value = line.partition("=")
        value = value.strip()
        place = f"line {number}: {key}"
        if options := _view_of_command(line):
            views.append(options)
            view_line = number
        if not equals:
            continue
        if key == "FORMAT":
            form = value
        elif key == "CAPDATE":
            captured = value[:32]
        elif key == "VIEW":
            views.append(value)
            view_line = number
        elif key == "EXPOSURE":
            exposure *= _positive(value, 1, file, place)[0]
        elif key == "COLORCORR":
            correction = correction * _positive(value, 3, file, place)
        elif key == "PRIMARIES":
            primaries = tuple(_numbers(value, 8, file, place))  # type: ignore[assignment]
            _refuse_primaries(primaries, file, place)
    if form not in (RGBE, XYZE):
        raise InputError(file, "FORMAT", form, f"give {RGBE} or {XYZE}")
    factors = exposure * correction
    if not (factors.min() > 1e-30 and factors.max() < 1e30):
        raise InputError(file, "EXPOSURE", f"{exposure:g} in all", "give 1e-30 to 1e30")
    view = from_options(" ".join(views), file, view_line) if views else None
    exposure = float(exposure)
    return HdrHeader(form, view, exposure, correction, primaries, captured, resolution, last + 1)


def _view_of_command(line: str) -> str:
    """Options of the view in a command line of a header; "" where it is none.

    Lines that a tab indents are of pictures from which this one was made.
    """
    program, *words = line.split() or [""]
    if line[:1].isspace() or Path(program).name not in _PROGRAMS:
        return ""
    options = []
    for at, word in enumerate(words):
        if re.fullmatch(r"-vt[a-z]", word):
            options.append(word)
        elif re.fullmatch(r"-v[pduhvsl]", word):
            values = words[at + 1 : at + 1 + _NUMBERS[word[2]]]
            if len(values) == _NUMBERS[word[2]]:
                options += [word, *values]
    return " ".join(options)


def _resolution(line: str, file: Path) -> tuple[str, str, int, str, str, int]:
    match = _RESOLUTION.fullmatch(line)
    if match is None or match[2] == match[5]:
        raise InputError(file, "resolution", line, "give a line such as -Y 512 +X 512")
    return match[1], match[2], int(match[3]), match[4], match[5], int(match[6])


def _numbers(value: str, count: int, file: Path, place: str) -> list[float]:
    try:
        numbers = [float(word) for word in value.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise InputError(file, place, value, f"give finite numbers, {count} in all")
    return numbers


def _positive(value: str, count: int, file: Path, place: str) -> np.ndarray:
    numbers = _numbers(value, count, file, place)
    if not min(numbers) > 0:
        raise InputError(file, place, value, "give numbers above 0")
    return np.array(numbers)


def _refuse_primaries(primaries: Primaries, file: Path, place: str) -> None:
    try:
        to_xyz(primaries)
    except InputError as error:
        raise InputError(file, place, error.got, error.remedy) from None


def text(picture: Picture, exposure: float) -> str:
    """Header of a picture whose values are multiplied by an exposure, from the top left."""
    rows, columns = picture.shape
    lines = ["#?RADIANCE", "SOFTWARE= drcmitsuba"]
    if picture.captured:
        lines.append(f"CAPDATE= {' '.join(picture.captured.split())}")
    if picture.view is not None:
        lines.append(f"VIEW= {picture.view.options()}")
    if picture.primaries != RADIANCE:
        lines.append(f"PRIMARIES= {' '.join(f'{v:.6g}' for v in picture.primaries)}")
    if exposure != 1:
        lines.append(f"EXPOSURE= {exposure:.9g}")
    return "\n".join([*lines, f"FORMAT={RGBE}", "", f"-Y {rows} +X {columns}", ""])
