"""Glass of a gbXML building, by its window types."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from drcmitsuba.model.gbxml.entries import GbxmlEntry


class WindowType(NamedTuple):
    """Kind of windows. Several may share a name: identifiers alone are those of one."""

    name: str
    transmittance: float | None
    """Visible transmittance at normal incidence [–]; None where it is not stated."""


def window_types(root: GbxmlEntry) -> Mapping[str, WindowType]:
    """Window types by their identifiers.

    Raises
    ------
    InputError
        A transmittance is no number from 0 to 1.
    """
    types = {}
    for entry in root.children("WindowType"):
        name = entry.text("Name") or entry.attribute("id")
        types[entry.attribute("id")] = WindowType(name, _visible(entry))
    return types


def _is_normal(entry: GbxmlEntry) -> bool:
    """Whether a transmittance is that at normal incidence, as it is where no angle is stated."""
    try:
        return float(entry.attribute("solarIncidentAngle") or 0) == 0
    except ValueError:
        return False


def _visible(entry: GbxmlEntry) -> float | None:
    """Visible transmittance at normal incidence [–]; None where it is not stated."""
    for each in entry.children("Transmittance"):
        if each.attribute("type") != "Visible" or not _is_normal(each):
            continue
        value = each.number()
        if value is not None and each.attribute("unit") == "Percent":
            value /= 100
        if value is not None and not 0 <= value <= 1:
            raise entry.refuse("Transmittance", f"{value:g}", "give a fraction from 0 to 1")
        return value
    return None
