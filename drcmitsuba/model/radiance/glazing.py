"""Panes of Radiance's `BRTDfunc`, as glazing tools write it, as `GlazingMaterial`.

The engine's pane has Schlick's reflectance and τ(θ) = τ₀ [1 − (1 − cos θ)ᵖ]. τ₀ and ρ₀ are taken at
normal incidence; p is fitted.
"""

from __future__ import annotations

from pathlib import PurePath

import numpy as np

from drcmitsuba.model.materials import GlazingMaterial
from drcmitsuba.model.radiance import expression
from drcmitsuba.model.radiance.text import Primitive
from drcmitsuba.model.radiance_materials import luminance

INCIDENCE = np.radians(np.arange(90.0))
"""Incidences of the fit [rad]."""
OWN = ("rho", "rho", "rho", "tau", "tau", "tau", "0", "0", "0", "glazing.cal")
"""Strings of panes by the engine's own formula."""
_EXPONENTS = np.geomspace(0.2, 100, 2001)

_FRESNEL = "fresne=exp(-5.85*abs(Rdot))-exp(-5.85);"
_LOW_E = "".join(
    f"sr_clear_{c}=fresne_refl(if(A10*Rdot,A{11 + i},A{14 + i}));"
    f"st_clear_{c}=fresne_trans(A{17 + i});"
    for i, c in enumerate("rgb")
)
FUNCTION_FILES = {
    ".": "",
    "glaze1.cal": f"{_FRESNEL}fresne_refl(r)=r+fresne*(1-r);fresne_trans(t)=t*(1-fresne);{_LOW_E}",
    "glaze2.cal": f"{_FRESNEL}fr(r)=r+fresne*(1-r);ft(t)=t*(1-fresne);"
    "rclr=fr(0.076);tclr=ft(0.883);cr(f,t,b)=f+t*t*b;",
}
"""Definitions of the function files that glazing tools name: single panes, double panes."""


def fitted(transmittance: np.ndarray, reflectance: float) -> tuple[GlazingMaterial, float]:
    """Pane of the engine that is nearest to a transmittance over the incidence.

    The exponent has the least squared error of the transmitted flux under uniform light, among
    those with which transmittance and reflectance together never exceed 1.

    Parameters
    ----------
    transmittance : np.ndarray, shape (90,)
        Transmittance at `INCIDENCE` [–].
    reflectance : float
        Reflectance at normal incidence [–].

    Returns
    -------
    material : GlazingMaterial
    deviation : float
        Largest difference of the transmittances [–].
    """
    at_normal = float(transmittance[0])
    x = 1 - np.cos(INCIDENCE)
    shape = 1 - x ** _EXPONENTS[:, None]
    difference = at_normal * shape - transmittance
    dense = np.linspace(0, 1, 201)
    mirrored = reflectance + (1 - reflectance) * dense**5 if reflectance > 0 else 0 * dense
    sums = at_normal * (1 - dense ** _EXPONENTS[:, None]) + mirrored
    error = (difference**2 * np.sin(2 * INCIDENCE)).sum(axis=1)
    error[sums.max(axis=1) > 1 + 1e-9] = np.inf
    best = int(np.argmin(error))
    material = GlazingMaterial(
        type="glazing",
        transmittance=at_normal,
        exponent=float(_EXPONENTS[best]),
        reflectance=reflectance,
    )
    return material, float(np.abs(difference[best]).max())


def from_functions(primitive: Primitive) -> tuple[GlazingMaterial, float]:
    """Pane for a `BRTDfunc` whose functions are numbers or those of `genglaze`'s kind of tools.

    The reflectance is that of the front.

    Raises
    ------
    InputError
        The material scatters light, or its functions are not understood.
    """
    remedy = "give the glazing as glass, as BSDF, or as BRTDfunc of glaze1.cal or glaze2.cal"
    strings, numbers = primitive.strings, primitive.numbers
    if len(strings) < 10 or len(numbers) < 9:
        got = f"{len(strings)} strings and {len(numbers)} numbers"
        raise primitive.error(got, "give at least 10 strings and 9 numbers")
    file = PurePath(strings[9]).name or "."
    if (*strings[:9], file) == OWN and len(numbers) == 12:  # as `export` writes the engine's panes
        tau, exponent, rho = numbers[9:]
        try:
            pane = GlazingMaterial(
                type="glazing", transmittance=tau, exponent=exponent, reflectance=rho
            )
        except ValueError:
            got = f"transmittance, exponent and reflectance {tau:g} {exponent:g} {rho:g}"
            raise primitive.error(got, "keep to what a pane can have") from None
        return pane, 0.0
    if file not in FUNCTION_FILES:
        raise primitive.error(f"the function file {strings[9]!r}", remedy)
    if any(numbers[:9]) or any(text != "0" for text in strings[6:9]):
        raise primitive.error("a part that scatters light", remedy)
    variables = {"Rdot": np.cos(INCIDENCE)}
    variables |= {f"A{i}": np.float64(v) for i, v in enumerate(numbers, 1)}
    try:
        known = expression.definitions(FUNCTION_FILES[file])
        values = [expression.value(text, variables, known) for text in strings[:6]]
    except expression.ExpressionError as error:
        raise primitive.error(str(error), remedy) from None
    channels = np.stack([np.broadcast_to(v, INCIDENCE.shape) for v in values], axis=1)
    if (
        not ((channels >= 0) & (channels <= 1)).all()
        or (channels[:, :3] + channels[:, 3:] > 1 + 1e-6).any()
    ):
        got = "reflectance and transmittance that are no shares of the light"
        raise primitive.error(got, "keep each and their sum within 0 and 1")
    return fitted(luminance(channels[:, 3:]), float(luminance(channels[0, :3])))
