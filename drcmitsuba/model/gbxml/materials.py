"""Glass of a gbXML building, by its window types."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain, count

from drcmitsuba.model.gbxml.entries import GbxmlEntry
from drcmitsuba.model.unstated import GLASS


def window_types(root: GbxmlEntry) -> Mapping[str, tuple[str, float | None]]:
    """Name and visible transmittance of every window type, by its identifier; None where unstated.

    Types of one name and another transmittance are numbered: names are free, identifiers are not.

    Raises
    ------
    InputError
        A transmittance is no number from 0 to 1.
    """
    types, known = {}, dict[str, float | None]({GLASS: None})
    for entry in root.children("WindowType"):
        own, transmittance = entry.text("Name") or entry.attribute("id"), _visible(entry)
        names = chain([own], (f"{own} ({k})" for k in count(2)))
        name = next(n for n in names if known.setdefault(n, transmittance) == transmittance)
        types[entry.attribute("id")] = name, transmittance
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
