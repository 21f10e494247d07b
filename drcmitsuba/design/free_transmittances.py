"""Transmittances of clear panes and of the shade as parameters of a search.

The light by an element is proportional to the transmittance of the pane that it comes in by, and
what the pane sends back into the room stays: a `Factor` of the light is another transmittance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.design import Design
from drcmitsuba.design.parameters import Factor, Parameter
from drcmitsuba.model.materials import DiffuserMaterial, GlazingMaterial, check_energy
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import checked, shortened

GLAZING = "glazing_transmittance"
"""Key of the transmittance of clear panes."""


def free_transmittances(case: Case, design: Design, clear: Sequence[str]) -> tuple[Factor, ...]:
    """Factors of the `clear` materials and of the shade whose transmittance `[design]` sets free.

    Several clear materials take one transmittance.

    Raises
    ------
    InputError
        A material is no glazing or diffuser whose light is proportional to its transmittance, the
        largest one and its reflectance exceed 1 together, or a component has the material, too:
        its light is not of the façade.
    """
    shade = () if case.shading is None else (case.shading.material,)
    named = (
        (GLAZING, clear, design.glazing_transmittance),
        ("shade_vlt", shade, design.shade_vlt),
    )
    factors = []
    for key, names, limits in named:
        if limits is None:
            continue
        field = f"design.{key}"
        if not names:
            got = "no shade: its transmittance is not known"
            raise InputError(case.source, field, got, "add [shading] with its material")
        if case.model is not None and case.model.leaks == "allow":
            got = "the rooms may be open: which light comes by panes from outside is not told"
            raise InputError(case.source, field, got, "close the rooms, or compare cases by study")
        _refuse_in_components(case, field, names)
        now = {name: _transmittance(case, field, name, limits[1]) for name in names}
        start = float(np.clip(next(iter(now.values())), *limits))
        factors.append(Factor(now, Parameter(key, *limits, start)))
    return tuple(factors)


def with_transmittances(
    case: Case, factors: Sequence[Factor], values: Mapping[str, np.ndarray]
) -> Case:
    """Case whose materials have the transmittances of `values` (1,) by parameter."""
    materials = dict(case.materials)
    for factor in factors:
        for name in factor.now:
            table = materials[name].model_dump()
            table |= {"transmittance": float(values[factor.parameter.key][0])}
            materials[name] = checked(type(materials[name]), table, case.source)
    return case.with_tables(materials=materials)


def _refuse_in_components(case: Case, field: str, names: Sequence[str]) -> None:
    """Refuse materials of components."""
    for key, component in case.components.items():
        for part in component.kinds:
            if (name := getattr(component, part)) in names:
                got = f"components.{shortened(key)}.{part} is {shortened(name)}, too"
                remedy = "give it a material of its own, which may be alike"
                raise InputError(case.source, field, got, remedy)


def _transmittance(case: Case, field: str, name: str, most: float) -> float:
    """Transmittance of a material, to which its light is proportional up to the largest one."""
    material, now = case.materials.get(name), None
    if isinstance(material, GlazingMaterial | DiffuserMaterial):
        now = material.transmittance
    if not isinstance(now, float) or not now > 0:
        got = f"{shortened(name)}: its transmittance is not known"
        remedy = "use a glazing or diffuser that lets light through, alike at any incidence"
        raise InputError(case.source, field, got, remedy)
    if isinstance(material, GlazingMaterial):
        exponent = material.exponent
        if material.ior is not None:
            got = f"{shortened(name)}: by its refractive index, each angle changes in its own way"
            remedy = "give it a reflectance in place of ior, in a table of [materials]"
            raise InputError(case.source, field, got, remedy)
    else:
        assert isinstance(material, DiffuserMaterial)
        exponent = 0.0
        if material.most_straight > 0:
            got = f"{shortened(name)}: light goes straight through it, too"
            raise InputError(case.source, field, got, "leave out straight, or evaluate each fabric")
    try:
        check_energy(most, max(material.sides), exponent)
    except InputError as error:
        got = f"up to {most:g}: {error.got}"
        raise InputError(case.source, field, got, "lower its end") from None
    return now
