"""BSDF files: LBNL's XML with tensor trees or Klems matrices, as Radiance reads it.

Directions point away from the surface; +z is the side of the room (Radiance's front, the file's
"Back"), +y is up. Components are named by the side that light arrives from and where it goes:

==========  ===========================  ====================================
component   WavelengthDataDirection      light
==========  ===========================  ====================================
`tb`        Transmission Front           from outside (−z) into the room
`tf`        Transmission Back            from the room (+z) to the outside
`rb`        Reflection Front             from outside, reflected
`rf`        Reflection Back              from the room, reflected
==========  ===========================  ====================================
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias
from xml.etree.ElementTree import Element

import numpy as np
from defusedxml import ElementTree
from defusedxml.common import DefusedXmlException
from drcmitsuba_plugins import braces, colour
from drcmitsuba_plugins.klems_basis import BASES, KlemsMatrix
from drcmitsuba_plugins.tensor import TensorTree, to_direction

MAX_BYTES = 1 << 28
"""Largest file that is read: a full tree of rank 4 and depth 6 has about half of that."""
NEGLIGIBLE = 1e-4
"""Negative values above −NEGLIGIBLE · the largest are noise and count as 0."""

_COMPONENTS = {
    "transmissionfront": "tb",
    "transmissionback": "tf",
    "reflectionfront": "rb",
    "reflectionback": "rf",
}
_RANKS = {"tensortree4": 4, "tensortree3": 3}
_COLOUR = {"cie-u": "u", "cie-v": "v", "cie-x": "X", "cie-z": "Z"}


class BsdfFileError(ValueError):
    """A BSDF file that cannot be used; one line names file, field, what came and remedy."""

    def __init__(self, source: object, field: str, got: str, remedy: str):
        self.source, self.field, self.got, self.remedy = str(source), field, got, remedy
        super().__init__(" ".join(f"{source}: {field}: {got}; {remedy}".split()))


@dataclass(frozen=True)
class Swapped:
    """A tree with incident and outgoing directions exchanged, for look-ups."""

    tree: TensorTree

    def values(self, incident: np.ndarray, outgoing: np.ndarray) -> np.ndarray:
        """BSDF f [1/sr] of pairs of directions (…, 3)."""
        return self.tree.values(outgoing, incident)

    def hemispherical(self, incident: np.ndarray) -> np.ndarray:
        """Directional-hemispherical value of directions (n, 3); rank 3 by 256² points."""
        if self.tree.rank == 4:
            return self.tree.collected(incident)
        u = (np.arange(256) + 0.5) / 256
        out = to_direction(*(a.ravel() for a in np.meshgrid(u, u)))
        return np.array([np.pi * self.tree.values(out, d[None]).mean() for d in incident])


Component: TypeAlias = TensorTree | KlemsMatrix | Swapped


@dataclass(frozen=True)
class BsdfFile:
    """Contents of a BSDF file: components, their colour, names.

    Parameters
    ----------
    source : str
    name, manufacturer : str
    kind : str
        'TensorTree4', 'TensorTree3' or 'Klems'.
    components : dict of str to TensorTree or KlemsMatrix
        Luminance; only those that the file holds.
    colour : dict of str to dict
        Chromaticity of components, by 'u' and 'v' (trees), or X and Z (Klems).
    notes : tuple of str
    """

    source: str
    name: str
    manufacturer: str
    kind: str
    components: dict[str, TensorTree | KlemsMatrix]
    colour: dict[str, dict[str, TensorTree | KlemsMatrix]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def component(self, name: str) -> Component | None:
        """A component; transmission that the file lacks follows from the other by reciprocity."""
        if name in self.components:
            return self.components[name]
        other = self.components.get({"tf": "tb", "tb": "tf"}.get(name, ""))
        if other is None:
            return None
        return Swapped(other) if isinstance(other, TensorTree) else other.reversed()

    def of_channel(self, channel: int) -> BsdfFile:
        """Colour channel 0, 1, 2 (red, green, blue; ITU-R BT.709) in place of the luminance.

        Channel −1 and components without chromaticity stay as they are.
        """
        if channel < 0:
            return self
        red, green, blue = (float(channel == c) for c in range(3))
        return self.mixed((red, green, blue))

    def mixed(self, mix: tuple[float, ...]) -> BsdfFile:
        """Weighted sum of red, green and blue in place of the luminance; see `colour.mixed`.

        Components without chromaticity are multiplied by the sum of the weights; one weight
        multiplies the luminance of all.
        """
        changed = {
            name: colour.mixed(component, self.colour.get(name, {}), mix)
            for name, component in self.components.items()
        }
        return replace(self, components=changed)

    def query(self, incident: np.ndarray, outgoing: np.ndarray) -> np.ndarray:
        """BSDF f [1/sr], without the cosine, of pairs of directions.

        Parameters
        ----------
        incident, outgoing : np.ndarray, shape (n, 3)
            Unit vectors that point away from the pane; +z is the room.

        Returns
        -------
        np.ndarray, shape (n,)
        """
        incident, outgoing = np.atleast_2d(incident, outgoing)
        result = np.zeros(len(incident))
        names = (("tf", 1, -1), ("tb", -1, 1), ("rf", 1, 1), ("rb", -1, -1))
        for name, from_side, to_side in names:
            mine = (incident[:, 2] * from_side > 0) & (outgoing[:, 2] * to_side > 0)
            component = self.component(name) if mine.any() else None
            if component is not None:
                result[mine] = component.values(incident[mine], outgoing[mine])
        return result

    def hemispherical(self, incident: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Directional-hemispherical transmittance and reflectance.

        Parameters
        ----------
        incident : np.ndarray, shape (n, 3)
            Unit vectors towards the light; +z is the room.

        Returns
        -------
        transmittance, reflectance : np.ndarray, shape (n,)
        """
        incident = np.atleast_2d(incident)
        totals = np.zeros((2, len(incident)))
        for name, row, side in (("tf", 0, 1), ("tb", 0, -1), ("rf", 1, 1), ("rb", 1, -1)):
            mine = incident[:, 2] * side > 0
            component = self.component(name) if mine.any() else None
            if component is not None:
                totals[row, mine] = component.hemispherical(incident[mine])
        return totals[0], totals[1]


def _text(parent: Element, name: str, default: str = "") -> str:
    element = parent.find(name)
    return default if element is None or element.text is None else element.text.strip()


def _bytes(path: Path) -> bytes:
    """Content of a plain file of at most `MAX_BYTES`."""
    try:
        if not path.is_file():  # a device would never end
            got = "no plain file" if path.exists() else "No such file or directory"
            raise BsdfFileError(path, "file", got, "name a BSDF file")
        size = path.stat().st_size
        if size > MAX_BYTES:
            remedy = f"give at most {MAX_BYTES >> 20} MB; reduce the tree (rttree_reduce)"
            raise BsdfFileError(path, "size", f"{size >> 20} MB", remedy)
        return path.read_bytes()
    except OSError as error:
        raise BsdfFileError(path, "file", str(error.strerror), "name a BSDF file") from None


def _parse(path: Path, raw: bytes) -> Element:
    """Root element of an XML file without namespaces; entities and doctypes are refused."""
    start = raw.find(b"<?xml")
    start = raw.find(b"<") if start < 0 else start
    try:
        root = ElementTree.fromstring(raw[max(start, 0) :], forbid_dtd=True)
    except DefusedXmlException as error:
        got = f"{type(error).__name__}: entities and document types are refused"
        raise BsdfFileError(path, "XML", got, "remove the DOCTYPE") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise BsdfFileError(path, "XML", str(error), "give a whole BSDF XML file") from None
    for element in root.iter():
        if isinstance(element.tag, str):
            element.tag = element.tag.rpartition("}")[2]
    return root


def _numbers(path: Path, where: str, text: str) -> np.ndarray:
    words = text.replace(",", " ").split()
    try:
        return np.array(words, float)
    except ValueError:
        wrong = next(w for w in words if not _is_number(w))
        remedy = "give numbers"
        raise BsdfFileError(path, where, f"{wrong[:20]!r} is no number", remedy) from None


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _clean(path: Path, where: str, value: np.ndarray) -> np.ndarray:
    """Refuse NaN, infinite and negative values; noise below zero counts as zero."""
    if not np.isfinite(value).all():
        raise BsdfFileError(path, where, "a value is not finite", "correct the data")
    if value.size and value.min() < -NEGLIGIBLE * max(value.max(), 0):
        remedy = "a BSDF is nowhere negative: correct the data"
        raise BsdfFileError(path, where, f"the value {value.min():g} is negative", remedy)
    value = np.maximum(value, 0)
    value.flags.writeable = False  # `read` gives the same numbers to all
    return value


def _tree(path: Path, where: str, text: str, rank: int) -> TensorTree:
    try:
        tree = braces.read(text, rank)
    except ValueError as error:
        remedy = "the tree must be whole: write the file again"
        raise BsdfFileError(path, where, str(error), remedy) from None
    return replace(tree, value=_clean(path, where, tree.value))


def _matrix(path: Path, where: str, block: Element, text: str, rows: bool) -> KlemsMatrix:
    bases = []
    for tag in ("ColumnAngleBasis", "RowAngleBasis"):
        name = _text(block, tag, _text(block, "AngleBasis"))
        if name not in BASES:
            remedy = f"known bases are {', '.join(BASES)}"
            raise BsdfFileError(path, f"{where}: {tag}", f"{name[:40]!r}", remedy)
        bases.append(BASES[name])
    incident, outgoing = bases
    value = _clean(path, where, _numbers(path, where, text))
    wanted = len(incident) * len(outgoing)
    if value.size != wanted:
        got = f"{value.size} numbers for {len(outgoing)} × {len(incident)} patches"
        raise BsdfFileError(path, where, got, f"give {wanted}")
    if rows:
        return KlemsMatrix(incident, outgoing, value.reshape(len(incident), len(outgoing)).T)
    return KlemsMatrix(incident, outgoing, value.reshape(len(outgoing), len(incident)))


def read(path: str | Path) -> BsdfFile:
    """Read a BSDF file.

    Parameters
    ----------
    path : str or Path
        LBNL XML with TensorTree4, TensorTree3 or Klems (full, half, quarter; rows or columns).

    Returns
    -------
    BsdfFile

    Raises
    ------
    BsdfFileError
        No BSDF XML, an unknown structure or basis, wrong, missing, negative or non-finite numbers.

    Notes
    -----
    The last two files are kept: all states of a scene share them. Limits: visible data only;
    wavelength blocks other than Visible and its chromaticity are left out; a geometry within the
    file is ignored; one layer.
    """
    path = Path(path)
    return _read(path, _bytes(path))


@lru_cache(maxsize=2)
def _read(path: Path, raw: bytes) -> BsdfFile:
    root = _parse(path, raw)
    layer = root.find(".//Layer")
    if layer is None:
        raise BsdfFileError(path, "Layer", "there is none", "give an LBNL BSDF XML file")
    structure = _text(layer, "DataDefinition/IncidentDataStructure", "Columns")
    rank = _RANKS.get(structure.lower())
    if rank is None and structure.lower() not in ("rows", "columns"):
        remedy = "known are TensorTree3, TensorTree4, Rows and Columns"
        raise BsdfFileError(path, "IncidentDataStructure", repr(structure[:40]), remedy)
    channels: dict[str, dict[str, Any]] = {"Y": {}}
    for data in layer.findall("WavelengthData"):
        wavelength = _text(data, "Wavelength").lower()
        channel = "Y" if wavelength == "visible" else _COLOUR.get(wavelength)
        if channel is None:
            continue
        for block in data.findall("WavelengthDataBlock"):
            direction = _text(block, "WavelengthDataDirection")
            name = _COMPONENTS.get(re.sub(r"\s", "", direction).lower())
            if name is None:
                continue  # such as "Absorptance Front" of files by WINDOW
            where = f"{wavelength} {direction}"
            text = _text(block, "ScatteringData")
            if not text:
                raise BsdfFileError(path, where, "no ScatteringData", "give the numbers")
            of_channel = channels.setdefault(channel, {})
            if rank is not None:
                of_channel[name] = _tree(path, where, text, rank)
            else:
                of_channel[name] = _matrix(path, where, block, text, structure.lower() == "rows")
    if not channels["Y"]:
        remedy = "give data of wavelength Visible"
        raise BsdfFileError(path, "WavelengthData", "no visible data", remedy)
    components = channels.pop("Y")
    chromaticity: dict[str, dict[str, Any]] = {}
    for channel, blocks in channels.items():
        for name, component in blocks.items():
            chromaticity.setdefault(name, {})[channel] = component
    return BsdfFile(
        source=str(path),
        name=_text(layer, "Material/Name"),
        manufacturer=_text(layer, "Material/Manufacturer"),
        kind="Klems" if rank is None else f"TensorTree{rank}",
        components=components,
        colour=chromaticity,
    )
