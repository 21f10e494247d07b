"""Which effects a case calls for, and why."""

from __future__ import annotations

from typing import Any

from drcmitsuba.case import Case, DiffuserMaterial, GlazingMaterial
from drcmitsuba.scene import is_coloured


def plan(case: Case, suns: int, closed: int, hours: int) -> dict[str, dict[str, Any]]:
    """List the effects with whether each is simulated and the reason in words.

    Parameters
    ----------
    case : Case
    suns : int
        Suns above the horizon in the period.
    closed, hours : int
        Time stamps with the shade closed, and in all.

    Returns
    -------
    dict
        {effect: {"on": bool, "reason": str}}; `missing` is true for what the case calls for and
        the program cannot do.
    """
    panes = {
        side: [case.materials[s.material] for s in f.strips if s.material in case.materials]
        for side, f in case.facade.items()
    }
    glazed = [
        side for side, f in case.facade.items() if any(s.material != "wall" for s in f.strips)
    ]
    mirrors = [
        side
        for side, materials in panes.items()
        if any(isinstance(m, GlazingMaterial) and m.reflectance > 0 for m in materials)
    ]
    # The sun that comes in by one façade and is mirrored by the glass of another.
    mirrored = bool(mirrors) and len(glazed) > 1
    scattering = sum(isinstance(m, DiffuserMaterial) for ms in panes.values() for m in ms)
    clear = sum(isinstance(m, GlazingMaterial) for ms in panes.values() for m in ms)
    ground = case.outside.ground_reflectance
    shaded = "no [shading] in the case"
    if case.shading is not None:
        shaded = f"the shade closes in {closed} of {hours} time stamps"
    return {
        "sky": {"on": True, "reason": "145 patches"},
        "ground": {"on": ground > 0, "reason": f"its reflectance is {ground:g}"},
        "suns": {"on": suns > 0, "reason": f"{suns} suns above the horizon in the period"},
        "clear_panes": {"on": clear > 0, "reason": f"{clear} clear strips in the façades"},
        "scattering_panes": {"on": scattering > 0, "reason": f"{scattering} diffusing strips"},
        "shaded_state": {"on": closed > 0, "reason": shaded},
        "colour": {
            "on": is_coloured(case),
            "reason": "a reflectance differs between channels"
            if is_coloured(case)
            else "all reflectances are grey: one channel",
        },
        "mirrored_light": {
            "on": False,
            "missing": mirrored,
            "reason": "light that enters by one façade and is mirrored by the glass of another "
            f"({', '.join(mirrors)}) before it meets a surface is not simulated"
            if mirrored
            else "no mirroring glass across from another opening",
        },
    }
