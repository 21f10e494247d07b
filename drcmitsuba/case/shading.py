"""The table `[shading]` of a case: the sun shade of the clear panes and when it closes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from drcmitsuba.model.materials import BsdfMaterial, DiffuserMaterial, Material
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Fraction, Illuminance, Table, choose, named_of_kind, shortened

THRESHOLD = 1000.0
"""Direct sun from which on a point needs the shade, by LM-83 [lx]."""
AREA = 0.02
"""Fraction of the points from which on the shade closes, by LM-83 [–]."""


class Shading(Table):
    """Sun shade; the closed shade replaces the clear panes and the holes."""

    material: str
    """Material of the closed shade: a diffuser or a bsdf of [materials]."""
    threshold: Illuminance = THRESHOLD
    """Direct sun from which on a point needs the shade [lx]."""
    area: Fraction = AREA
    """Fraction of points [–]; the shade closes where at least this fraction of a grid needs it."""
    groups: Literal["facing", "spaces", "together"] = "facing"
    """Panes that close together, where there is no [groups]: those that face the same direction;
    those of one space that do, by the sun on its sensors alone; or all of them."""

    @property
    def by_space(self) -> bool:
        """Whether the shade of every space closes by itself."""
        return self.groups == "spaces"

    def check(self, materials: Mapping[str, Material]) -> None:
        """Raise InputError for a material that is unknown, or neither a diffuser nor a bsdf."""
        known = named_of_kind(materials, (DiffuserMaterial, BsdfMaterial))
        if self.material not in known:
            got = f"{shortened(self.material)} is no diffuser or bsdf in [materials]"
            raise InputError("case", "shading.material", got, choose(self.material, known))
