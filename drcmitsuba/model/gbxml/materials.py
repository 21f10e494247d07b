"""Glass of a gbXML building, by its window types."""

from __future__ import annotations

from collections.abc import Mapping

from drcmitsuba.model.gbxml.entries import GbxmlEntry


def window_types(root: GbxmlEntry) -> Mapping[str, tuple[str, float | None]]:
    """Name and visible transmittance of every window type, by its identifier; None where unstated.

    Raises
    ------
    InputError
        A transmittance is no number from 0 to 1.
    """
    types = {}
    for entry in root.children("WindowType"):
        name = entry.text("Name") or entry.attribute("id")
        types[entry.attribute("id")] = name, _visible(entry)
    return types


def _visible(entry: GbxmlEntry) -> float | None:
    """Visible transmittance at normal incidence [–]; None where it is not stated."""
    for each in entry.children("Transmittance"):
        is_normal = each.attribute("solarIncidentAngle") in ("", "0")
        if each.attribute("type") != "Visible" or not is_normal:
            continue
        value = each.number()
        if value is not None and each.attribute("unit") == "Percent":
            value /= 100
        if value is not None and not 0 <= value <= 1:
            raise entry.refuse("Transmittance", f"{value:g}", "give a fraction from 0 to 1")
        return value
    return None
