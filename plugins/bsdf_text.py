"""Text of BSDF files: LBNL's XML with tensor trees, as Radiance and `bsdf_file` read it."""

from __future__ import annotations

import re
from xml.sax.saxutils import escape

from drcmitsuba_plugins import braces
from drcmitsuba_plugins.bsdf_file import BsdfFile
from drcmitsuba_plugins.tensor import TensorTree

DIGITS = 4
"""Significant digits of a value: rounding, 5e-4 at most, is far below the noise of ray counts."""

_DIRECTIONS = {
    "tf": ("Transmission Back", "BTDF"),
    "rf": ("Reflection Back", "BRDF"),
    "tb": ("Transmission Front", "BTDF"),
    "rb": ("Reflection Front", "BRDF"),
}

_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<WindowElement xmlns="http://windows.lbl.gov" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">
{comment}<WindowElementType>System</WindowElementType>
<FileType>BSDF</FileType>
<Optical>
<Layer>
	<Material>
		<Name>{name}</Name>
		<Manufacturer>{manufacturer}</Manufacturer>
		<DeviceType>Other</DeviceType>
		<Thickness unit="meter">{thickness:.6g}</Thickness>
		<Width unit="meter">1</Width>
		<Height unit="meter">1</Height>
	</Material>
	<DataDefinition>
		<IncidentDataStructure>{kind}</IncidentDataStructure>
	</DataDefinition>
"""

_BLOCK = """	<WavelengthData>
		<LayerNumber>System</LayerNumber>
		<Wavelength unit="Integral">Visible</Wavelength>
		<SourceSpectrum>CIE Illuminant D65 1nm.ssp</SourceSpectrum>
		<DetectorSpectrum>ASTM E308 1931 Y.dsp</DetectorSpectrum>
		<WavelengthDataBlock>
			<WavelengthDataDirection>{direction}</WavelengthDataDirection>
			<AngleBasis>LBNL/Shirley-Chiu</AngleBasis>
			<ScatteringDataType>{type}</ScatteringDataType>
			<ScatteringData>
{data}
			</ScatteringData>
		</WavelengthDataBlock>
	</WavelengthData>
"""

_FOOT = "</Layer>\n</Optical>\n</WindowElement>\n"


def _plain(text: str) -> str:
    """Text without the characters that XML forbids even as entities, on one line."""
    return "".join(c if c.isprintable() else " " for c in text)


def text(file: BsdfFile, thickness: float) -> str:
    """Write tensor trees as XML text.

    Parameters
    ----------
    file : BsdfFile
        Tensor trees to write; the notes become comments.
    thickness : float
        Thickness of the pane for the header [m]; its width and height are 1 m.
    """
    assert not file.colour
    # Two hyphens would end a comment.
    notes = [re.sub("-(?=-)", "- ", _plain(note)) for note in file.notes]
    comment = "".join(f"<!-- {note} -->\n" for note in notes)
    parts = [
        _HEAD.format(
            comment=comment, kind=file.kind,
            name=escape(_plain(file.name)), manufacturer=escape(_plain(file.manufacturer)),
            thickness=thickness,
        )
    ]  # fmt: skip
    for name, (direction, kind) in _DIRECTIONS.items():
        tree = file.components.get(name)
        if tree is not None:
            assert isinstance(tree, TensorTree), "matrices are not written"
            data = braces.write(tree, DIGITS)
            parts.append(_BLOCK.format(direction=direction, type=kind, data=data))
    return "".join([*parts, _FOOT])
