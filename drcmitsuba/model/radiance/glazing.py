"""Panes of Radiance's `BRTDfunc`: glazings, and fabrics with their function files.

The engine's glazing has Schlick's reflectance and τ(θ) = τ₀ [1 − (1 − cos θ)ᵖ]. τ₀ and ρ₀ are taken
at normal incidence; p is fitted. A pane that scatters is diffusing; the share of the light that
goes straight through it is tabulated over the cosine of the incidence.
"""

from __future__ import annotations

from pathlib import PurePath

import numpy as np

from drcmitsuba.model.materials import DiffuserMaterial, GlazingMaterial
from drcmitsuba.model.radiance import expression
from drcmitsuba.model.radiance.definitions import Definition
from drcmitsuba.model.radiance.text import decoded, sought
from drcmitsuba.model.radiance_materials import (
    COSINES,
    GREY,
    SCATTERED,
    Note,
    greyed,
    luminance,
    mean_of,
)

INCIDENCE = np.radians(np.arange(90.0))
"""Incidences of the fit [rad]."""
MOST_BYTES = 1 << 16
"""Largest size of a function file [byte]."""
SIDES = 0.005
"""Difference of the reflectances of both sides that is noted [–]."""
GLAZED = "Panes keep Radiance's transmittance at normal incidence and are at most"
ONE_SIDE = "Panes that scatter have the reflectance of their front on the room's side"
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


def noted_fit(transmittance: np.ndarray, reflectance: float, note: Note) -> GlazingMaterial:
    """Fit a pane as `fitted`, and note how far it is off."""
    material, deviation = fitted(transmittance, reflectance)
    # Rounded up to a whole hundredth, so that panes share a sentence.
    if deviation:
        note(f"{GLAZED} {np.ceil(100 * deviation) / 100:g} off at others")
    return material


def from_functions(definition: Definition, note: Note) -> GlazingMaterial | DiffuserMaterial:
    """Pane for a `BRTDfunc` whose functions depend on the incidence alone.

    Its function file is one of `FUNCTION_FILES`, or stands where files that a scene names are
    looked for. A pane that scatters nothing and mirrors is a glazing; any other is a diffusing one
    whose straight part is tabulated. The reflectance is that of the front, where the sides differ.

    Raises
    ------
    InputError
        It has directional diffuse parts, or its functions are not understood, take too many steps,
        depend on more than the incidence or give no shares of the light.
    """
    primitive = definition.primitive
    strings, numbers = primitive.strings, primitive.numbers
    if len(strings) < 10 or len(numbers) < 9:
        got = f"{len(strings)} strings and {len(numbers)} numbers"
        raise primitive.error(got, "give at least 10 strings and 9 numbers")
    file = PurePath(strings[9]).name or "."
    if (*strings[:9], file) == OWN and len(numbers) == 12:  # as `export` writes the engine's panes
        tau, exponent, rho = numbers[9:]
        try:
            return GlazingMaterial(
                type="glazing", transmittance=tau, exponent=exponent, reflectance=rho
            )
        except ValueError:
            got = f"transmittance, exponent and reflectance {tau:g} {exponent:g} {rho:g}"
            raise primitive.error(got, "keep to what a pane can have") from None
    if any(_number(text) != 0 for text in strings[6:9]):
        got = "directional diffuse parts, which depend on the source"
        raise primitive.error(got, "give 0 for the three of them, or the pane as BSDF")
    shares = _shares(definition)
    scattered = np.array(numbers[:9]).reshape(3, 3)  # front, back, through
    of_channel = shares.sum(axis=0).max(axis=0) + scattered[:2].max(axis=0) + scattered[2]
    most = float(of_channel.max())
    if not ((scattered >= 0).all() and most <= 1 + 1e-6):
        got = f"reflectance and transmittance that are no shares of the light: up to {most:.3g}"
        raise primitive.error(got, "keep each and their sum within 0 and 1")
    front, back, through = (float(luminance(part)) for part in scattered)
    every = np.concatenate([scattered, *shares])
    if np.ptp(every, axis=1).max() > GREY:
        note(greyed(every))
    mirrored, straight = luminance(shares[0]), luminance(shares[1])
    if front == back == through == 0 and mirrored[-1] > 0:
        over_angles = luminance(_shares(definition, np.cos(INCIDENCE))[1])
        return noted_fit(over_angles, float(mirrored[-1]), note)
    if mirrored.max() > 0:
        note(f"{SCATTERED}: up to {100 * mirrored.max():.2g} % of the light")
    if abs(front - back) > SIDES:
        note(f"{ONE_SIDE}, {front:.2f}, and not that of their back, {back:.2f}")
    rest = max(0.0, 1 - through - float(straight.max()))  # beside the peak of what goes straight
    inner, outer = (min(side + mean_of(mirrored), rest) for side in (front, back))
    return DiffuserMaterial(
        type="diffuser", transmittance=through, reflectance=inner, outer_reflectance=outer,
        straight=tuple(straight.tolist()) if straight.max() > 0 else 0.0,
    )  # fmt: skip


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


def _shares(definition: Definition, cosine: np.ndarray = COSINES) -> np.ndarray:
    """Mirrored and straight shares by cosine and channel, shape (2, cosine, 3), from the front."""
    primitive = definition.primitive
    remedy = "give functions of Rdot in its strings or its function file, or the pane as a BSDF"
    variables = {"Rdot": cosine}
    variables |= {f"A{i}": np.float64(v) for i, v in enumerate(primitive.numbers, 1)}
    try:
        known = expression.definitions(_functions(definition))
        values = [expression.value(text, variables, known) for text in primitive.strings[:6]]
    except expression.ExpressionError as error:
        raise primitive.error(str(error), remedy) from None
    shares = np.stack([np.broadcast_to(v, cosine.shape) for v in values], axis=-1)
    if not ((shares >= -1e-9) & (shares <= 1 + 1e-9)).all():
        least, most = np.nanmin(shares), np.nanmax(shares)
        got = f"reflectance and transmittance that are no shares of the light: {least:.3g} … "
        raise primitive.error(f"{got}{most:.3g}", "keep each and their sum within 0 and 1")
    return np.clip(shares, 0, 1).reshape(-1, 2, 3).swapaxes(0, 1)


def _functions(definition: Definition) -> str:
    """Definitions of the function file that a `BRTDfunc` names."""
    name = definition.primitive.strings[9]
    path = sought(name, definition.folders) if name != "." else None
    if path is None:
        known = PurePath(name).name or "."
        if known not in FUNCTION_FILES:
            where = ", ".join(str(folder) for folder in definition.folders)
            got = f"no function file {name!r} in {where}"
            raise definition.primitive.error(got, "put the file there")
        return FUNCTION_FILES[known]
    try:
        with path.open("rb") as file:
            text = file.read(MOST_BYTES + 1)
    except OSError as error:
        got = f"the function file {name!r}: {error.strerror}"
        raise definition.primitive.error(got, "make it readable") from None
    if len(text) > MOST_BYTES:
        got = f"the function file {name!r} of more than {MOST_BYTES} bytes"
        raise definition.primitive.error(got, "keep what the pane needs")
    return decoded(text)
