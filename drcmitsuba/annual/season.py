"""Monthly values relative to the season: the share of the month's daylight that a façade uses.

msDA is low in December for any façade; Bauer and Wittkopf leave open how to judge monthly values
[1]_. This module compares them with two references in the same room, from the same simulation:

- *clear*: all panes are clear glazing, the shade in use; the excess is the component's gain.
- *opening*: no panes and no shade: the daylight that the sky of the month offers here.

relative_m = msDA_m / msDA_m(opening). The definition is this program's own.

References
----------
.. [1] C. Bauer, S. Wittkopf, "Annual daylight simulations with EvalDRC", Journal of Facade Design
   and Engineering 3, 2015, section 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drcmitsuba.annual.elements import elements
from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import GlazingMaterial
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.scene.fills import HOLE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Months = list[dict[str, float] | None]


@dataclass(frozen=True)
class Season:
    """msDA of a façade, of clear glazing and of an unobstructed opening; shows itself in Jupyter.

    Parameters
    ----------
    design, clear, opening : list of dict or None
        msDA of twelve months, January first, as {"value", "low", "high"} [%]; None without hours.
    """

    name: str
    design: Months
    clear: Months
    opening: Months
    notes: tuple[str, ...] = ()
    """Sentences that tell what was assumed or left out."""

    @property
    def relative(self) -> list[float | None]:
        """Ratio of the msDA of design and opening [%]; None where the latter is 0 or None."""
        return [
            100 * month["value"] / most["value"] if month and most and most["value"] > 0 else None
            for month, most in zip(self.design, self.opening, strict=True)
        ]

    @property
    def gain(self) -> list[float | None]:
        """Difference of the msDA of design and clear glazing [points]."""
        return [
            month["value"] - clear["value"] if month and clear else None
            for month, clear in zip(self.design, self.clear, strict=True)
        ]

    def save(self, folder: str | Path) -> None:
        """Write `season.json` and `season.png`."""
        from drcmitsuba.report import plots

        folder = Path(folder)
        numbers: dict[str, Any] = {
            name: getattr(self, name) for name in ("design", "clear", "opening", "relative", "gain")
        }
        (folder / "season.png").unlink(missing_ok=True)  # of another case, if this run is stopped
        told = {"name": self.name, "msDA": numbers, "notes": self.notes}
        storage.save_json(told, folder / "season.json")
        plots.save(self._figure(), folder / "season.png")

    def _repr_png_(self) -> bytes:
        from drcmitsuba.report import plots

        return plots.png(self._figure())

    def _figure(self) -> Figure:
        from drcmitsuba.report import plots

        return plots.season(
            self.name, design=self.design, clear=self.clear, opening=self.opening,
            relative=self.relative,
        )  # fmt: skip


def season(case: Case, stage: Stage = silent) -> Season:
    """Evaluate a case beside clear glazing and an unobstructed opening, from one simulation.

    Raises
    ------
    InputError
        The materials have no glazing, or `elements` refuses the case.
    """
    glass = [name for name, m in case.materials.items() if isinstance(m, GlazingMaterial)]
    if not glass:
        remedy = "add the clear glazing to compare with to [materials]"
        raise InputError(case.source, "materials", "no glazing", remedy)
    used = {s.material for f in case.facade.values() for s in f.strips}
    used |= {layer.name for layer in case.building.layers}
    clear = next((name for name in glass if name in used), glass[0])
    shade = [] if case.shading is None else [case.shading.material]
    light = elements(case, [clear, HOLE, *shade], stage)
    every, empty = (dict.fromkeys(light.openings, fill) for fill in (clear, HOLE))
    results = (light.evaluate(), light.evaluate(drawn=every), light.evaluate(empty))
    every_note = (note for r in results for note in r.metrics["settings"]["notes"])
    design, clear_glazing, opening = (result.metrics["msDA"] for result in results)
    return Season(case.name, design, clear_glazing, opening, tuple(dict.fromkeys(every_note)))
