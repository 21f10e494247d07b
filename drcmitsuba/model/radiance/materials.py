"""Radiance's materials as materials of the engine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drcmitsuba.model import glass, radiance_materials
from drcmitsuba.model.materials import (
    DielectricMaterial,
    Lambertian,
    PorousMaterial,
    SurfaceMaterial,
    two_sided,
)
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.radiance import glazing, patterns
from drcmitsuba.model.radiance.definitions import MATERIALS, MIXTURES, Definition
from drcmitsuba.model.radiance.films import Mounted, film
from drcmitsuba.model.radiance.text import Primitive
from drcmitsuba.model.radiance_materials import SMALL, Colour, luminance, plastic

BLACK = "Daylight is the only light: lamps are black"
INVISIBLE = "Surfaces without a material are left out"
ISOTROPIC = "Brushed surfaces have the geometric mean of their two roughnesses"
DISPERSION = "Solids have one refractive index for all colours"

DEEPEST_MIXTURE = 8
"""Largest number of modifiers in a mixture that mixes: each doubles the materials that are read."""


@dataclass(frozen=True)
class Finish:
    """Material of a definition with the patterns that apply to it."""

    definition: Definition
    factor: np.ndarray
    """Factor of its colour, shape (3,)."""
    notes: Notes

    @property
    def primitive(self) -> Primitive:
        """Text that defines the material."""
        return self.definition.primitive

    def numbers(self, *counts: int, strings: int = 0) -> np.ndarray:
        """Arguments of the material; their number has to be one of the counts."""
        given = self.primitive.numbers
        if len(given) not in counts or len(self.primitive.strings) < strings:
            got = f"{len(self.primitive.strings)} strings and {len(given)} numbers"
            wanted = " or ".join(map(str, counts))
            remedy = f"give {f'{strings} strings or more and ' * (strings > 0)}{wanted} numbers"
            raise self.primitive.error(got, remedy)
        return np.array(given, float)

    def share(self, values: np.ndarray, what: str) -> np.ndarray:
        """Values, which have to lie within 0 and 1."""
        if not ((values >= 0) & (values <= 1)).all():
            got = f"{what} {' '.join(f'{v:g}' for v in np.atleast_1d(values))}"
            raise self.primitive.error(got, "keep within 0 and 1")
        return values

    def colour(self, numbers: np.ndarray) -> np.ndarray:
        """First three arguments under the patterns."""
        return self.share(numbers[:3] * self.factor, "a colour of")

    def note(self, sentence: str) -> None:
        """Note what is simplified of the material."""
        self.notes.add(sentence, self.definition.name)


def as_colour(channels: np.ndarray) -> Colour:
    """Red, green and blue as numbers."""
    red, green, blue = channels.tolist()
    return red, green, blue


def _opaque(finish: Finish) -> SurfaceMaterial:
    """Plastic and metal: diffuse C (1 − s), mirrored s, for metal C s, of roughness α."""
    brushed = finish.primitive.kind.endswith("2")
    numbers = finish.numbers(6 if brushed else 5, strings=4 if brushed else 0)
    colour = finish.colour(numbers)
    (s,) = finish.share(numbers[3:4], "a specular part of")
    make = radiance_materials.metal if finish.primitive.kind[:5] == "metal" else plastic
    rough = finish.share(np.minimum(numbers[4:], 1), "a roughness of")
    if s <= SMALL:
        return make(as_colour(colour), s, float(rough.max()), finish.note)
    if brushed:
        finish.note(_isotropic(rough))
    return make(as_colour(colour), s, float(np.prod(rough) ** (1 / len(rough))), finish.note)


def _isotropic(rough: np.ndarray) -> str:
    """Sentence on the mean of two roughnesses, with how far they are apart."""
    least, most = rough.min(), rough.max()
    apart = (
        f"up to {np.ceil(most / least - 1e-9):.0f} times apart"
        if least > 0
        else "of which one is 0"
    )
    return f"{ISOTROPIC}, {apart}"


def _trans(finish: Finish) -> SurfaceMaterial:
    """Diffusing sheet: with the transmitted share t, of which t_s is not scattered.

    It transmits C (1 − s) t and reflects C (1 − s) (1 − t) + s.
    """
    brushed = finish.primitive.kind.endswith("2")
    numbers = finish.numbers(8 if brushed else 7, strings=4 if brushed else 0)
    colour = finish.colour(numbers)
    s, t, t_s = finish.share(numbers[[3, -2, -1]], "shares of").tolist()
    rough = finish.share(np.minimum(numbers[4:-2], 1), "a roughness of")
    if brushed and t * t_s > 0:
        finish.note(_isotropic(rough))
    alpha = float(np.prod(rough) ** (1 / len(rough)))
    return radiance_materials.trans(as_colour(colour), s, alpha, t, t_s, finish.note)


def _pane(finish: Finish) -> SurfaceMaterial:
    """`glass`, and `BRTDfunc` of functions of the incidence."""
    if finish.primitive.kind == "glass":
        numbers = finish.numbers(3, 4)
        index = float(numbers[3]) if len(numbers) == 4 else radiance_materials.INDEX
        if not 1 < index <= 4:
            raise finish.primitive.error(f"a refractive index of {index:g}", "give 1 to 4")
        if (finish.factor != 1).any():
            return _patterned(finish, finish.share(numbers[:3], "a transmissivity of"), index)
        return radiance_materials.glass(as_colour(finish.colour(numbers)), index, finish.note)
    return glazing.from_functions(finish.definition, finish.note)


def _patterned(finish: Finish, transmissivity: np.ndarray, index: float) -> SurfaceMaterial:
    """`glass` under a pattern, which multiplies what it lets through and not what it mirrors."""
    tau, rho = glass.pane(transmissivity, index, np.cos(glazing.INCIDENCE))
    through = tau * finish.factor
    if not (through + rho <= 1 + 1e-9).all() or not (through >= 0).all():
        got = f"a pattern under which it transmits {' '.join(f'{v:.3g}' for v in through[0])}"
        raise finish.primitive.error(got, "keep it and what it mirrors within 0 and 1")
    radiance_materials.grey(through[0], finish.note)
    return glazing.noted_fit(luminance(through), float(luminance(rho[0])), finish.note)


def _solid(finish: Finish) -> SurfaceMaterial:
    """`dielectric`, and `interface` to air: clear solids with Beer's absorption per metre."""
    if finish.primitive.kind == "interface":
        numbers = finish.numbers(8)
        if (numbers[4:] != 1).any():
            got = "a medium outside that is not air (1 1 1 1)"
            raise finish.primitive.error(got, "leave a gap of air between the solids")
    else:
        numbers = finish.numbers(5)
        if numbers[4] != 0:
            finish.note(f"{DISPERSION} (Hartmann's constant {numbers[4]:g})")
    left = finish.share(numbers[:3], "a transmission of") ** (1 / finish.definition.moves.scale[0])
    rest = radiance_materials.grey(left, finish.note)
    if not 1 < numbers[3] <= 4 or not rest > 0 or -np.log(rest) > 1e4:
        got = f"index {numbers[3]:g} and a transmission of {rest:g} per metre"
        raise finish.primitive.error(got, "give an index of 1 to 4 and a transmission above 0")
    return DielectricMaterial(
        type="dielectric", ior=float(numbers[3]), absorption=float(max(0.0, -np.log(rest)))
    )


def _mirror(finish: Finish) -> SurfaceMaterial:
    """`mirror`, whose back is black in Radiance."""
    colour = finish.colour(finish.numbers(3))
    if finish.definition.named:
        if finish.definition.named[0] is None:
            got = "void as its alternate material, so it is seen by the sun only"
            raise finish.primitive.error(got, "take out the mirror or what it hides")
        finish.note(radiance_materials.REPLACED)
    finish.note(radiance_materials.BOTH_SIDES)
    return radiance_materials.mirror(as_colour(colour), finish.note)


def _lamp(finish: Finish) -> SurfaceMaterial:
    finish.note(BLACK)
    return Lambertian(0.0)


_COLOURED: dict[str, Callable[[Finish], SurfaceMaterial]] = {
    **dict.fromkeys(("plastic", "metal", "plastic2", "metal2"), _opaque),
    **dict.fromkeys(("trans", "trans2"), _trans),
    "glass": _pane,
    "mirror": _mirror,
    **dict.fromkeys(("light", "glow", "spotlight"), _lamp),
}
"""Kinds whose colour patterns change; lamps are black under any."""
_PLAIN: dict[str, Callable[[Finish], SurfaceMaterial | Mounted]] = {
    "BRTDfunc": _pane,
    **dict.fromkeys(("dielectric", "interface"), _solid),
    **dict.fromkeys(("BSDF", "aBSDF"), lambda finish: film(finish.definition)),
}


def _mixed(
    definition: Definition, share: float, parts: list[SurfaceMaterial | Mounted | None]
) -> SurfaceMaterial:
    """Material of a mixture of one share everywhere: diffuse reflectances mix, void is a gap."""
    weights = (share, 1 - share)
    matt = [part for part in parts if isinstance(part, Lambertian) and part.behind is None]
    void = [part is None for part in parts]
    if len(matt) == 2:
        mean = sum(w * channels_of(p) for w, p in zip(weights, matt, strict=True))
        return Lambertian(radiance_materials.reflectance(np.asarray(mean)))
    if len(matt) == 1 and any(void):
        gaps = weights[void.index(True)]
        return PorousMaterial(type="porous", porosity=gaps, reflectance=matt[0].reflectance)
    raise definition.primitive.error(
        f"a mixture of {100 * share:g} % of materials that are not both diffuse or void",
        "mix plastic and void, or name one material",
    )


def channels_of(material: Lambertian) -> np.ndarray:
    """Reflectance of red, green and blue, shape (3,)."""
    return np.broadcast_to(np.array(material.reflectance, float), 3)


def material_of(
    definition: Definition | None, means: bool, notes: Notes
) -> SurfaceMaterial | Mounted | None:
    """Material of surfaces that have a modifier.

    Parameters
    ----------
    definition : Definition or None
        Modifier of the surfaces; None for void.
    means : bool
        Whether patterns and mixtures that are not constant count as their mean.
    notes : Notes
        Takes in what is simplified.

    Returns
    -------
    SurfaceMaterial, Mounted or None
        Measured panes know their up direction; None is for surfaces that nothing sees.

    Raises
    ------
    InputError
        The material, or a pattern of it, has no counterpart.
    """
    above: list[Definition] = []
    if definition is not None and definition.primitive.kind in MIXTURES:
        share, sides = patterns.constant_share(definition), patterns.by_side(definition)
        is_mixed = share is not None and 0 < share < 1 and len(definition.named) > 1
        if (is_mixed or sides is not None) and definition.depth > DEEPEST_MIXTURE:
            got = f"mixtures of {definition.depth} modifiers within each other"
            raise definition.primitive.error(got, f"nest at most {DEEPEST_MIXTURE}")
        named = definition.named if sides is None else sides
        if sides is not None and sides[0] is sides[1]:
            return material_of(sides[0], means, notes)
        if is_mixed or sides is not None:
            parts = [None if each is None else material_of(each, means, notes) for each in named]
            if share is not None and sides is None:
                return _mixed(definition, share, parts)
            front, back = parts
            if isinstance(front, Lambertian) and isinstance(back, Lambertian):
                return two_sided(front, Lambertian(back.sides[1]))
            if not means:
                got = "a mixture of two sides of which one is not diffuse"
                raise definition.primitive.error(got, "name one material, or two of plastic")
    while definition is not None and definition.primitive.kind not in MATERIALS:
        if definition.primitive.kind in MIXTURES:
            definition = patterns.part(definition, means, notes)
        else:
            above.append(definition)
            definition = definition.modifier
    if definition is not None and definition.primitive.kind == "illum":
        # Nothing of it is seen but the material that it names.
        (definition,) = definition.named or (None,)
        if definition is not None:
            return material_of(definition, means, notes)
    if definition is None:
        notes.add(INVISIBLE)
        return None
    kind = definition.primitive.kind
    if kind not in _COLOURED and kind not in _PLAIN:
        raise definition.primitive.error(
            "a material without a counterpart here",
            "use plastic, metal, trans, glass, dielectric, mirror or a BSDF file",
        )
    if _COLOURED.get(kind) is _lamp:
        return _lamp(Finish(definition, np.ones(3), notes))
    below = definition.modifier
    while below is not None:
        above.append(below)
        below = below.modifier
    scale = np.ones(3)
    for pattern in above:
        if pattern.primitive.kind in (*MATERIALS, *MIXTURES):
            got = f"modified by {pattern.name!r}, which is a {pattern.primitive.kind}"
            raise definition.primitive.error(got, "modify materials by patterns only")
        scale = scale * patterns.factor(pattern, means, notes)
    if kind in _PLAIN:
        if (scale != 1).any():
            got = "a pattern other than 1"
            raise definition.primitive.error(got, "write the pattern into the material")
        return _PLAIN[kind](Finish(definition, scale, notes))
    return _COLOURED[kind](Finish(definition, scale, notes))
