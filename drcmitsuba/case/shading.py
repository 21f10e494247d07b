"""The table `[shading]` of a case: the sun shade of the clear panes and when it closes."""

from __future__ import annotations

from collections.abc import Mapping

from drcmitsuba.case.materials import BsdfMaterial, DiffuserMaterial, Material
from drcmitsuba.case.toml import Fraction, Illuminance, Table, choose, named_of_kind, shortened
from drcmitsuba.runtime.errors import InputError


class Shading(Table):
    """Sun shade; where it is closed, it stands in place of the clear panes and the holes."""

    material: str
    """Material of the closed shade: a diffuser or a bsdf of [materials]."""
    threshold: Illuminance = 1000.0
    """Direct sun from which on a point asks for the shade [lx]."""
    area: Fraction = 0.02
    """Fraction of the points that have to ask for it [–]; more or as many close the shade."""

    def check(self, materials: Mapping[str, Material]) -> None:
        """Refuse a shade of an unknown material, or of one that is no shade.

        Raises
        ------
        InputError
        """
        known = named_of_kind(materials, (DiffuserMaterial, BsdfMaterial))
        if self.material not in known:
            got = f"{shortened(self.material)} is no diffuser or bsdf in [materials]"
            raise InputError("case", "shading.material", got, choose(self.material, known))
