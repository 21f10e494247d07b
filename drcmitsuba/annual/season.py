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

from drcmitsuba.annual.variants import evaluate_variants
from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import GlazingMaterial
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.runtime.toml import Side
from drcmitsuba.transport import facade_basis

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

    def save(self, folder: Path) -> None:
        """Write `season.json` and `season.png`."""
        from drcmitsuba.report import plots

        numbers: dict[str, Any] = {
            name: getattr(self, name) for name in ("design", "clear", "opening", "relative", "gain")
        }
        storage.save_json({"name": self.name, "msDA": numbers}, folder / "season.json")
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
    """Evaluate a case, windows in one side, beside clear glazing and an unobstructed opening.

    Raises
    ------
    InputError
        The materials have no glazing, or `evaluate_variants` refuses the case.
    """
    case.refuse_components("a comparison of façades")
    case.refuse_groups("a comparison of façades")
    glass = [name for name, m in case.materials.items() if isinstance(m, GlazingMaterial)]
    if not glass:
        remedy = "add the clear glazing to compare with to [materials]"
        raise InputError(case.source, "materials", "no glazing", remedy)
    used = {s.material for f in case.facade.values() for s in f.strips}
    clear = next((name for name in glass if name in used), glass[0])
    side = facade_basis.side_of([case])
    cases = [case, filled(case, side, clear), filled(case, side, "open")]
    judged = [case, cases[1], cases[2].with_tables(shading=None)]
    monthly = [result.metrics["msDA"] for result in evaluate_variants(cases, stage, judged)]
    return Season(case.name, *monthly)


def filled(case: Case, side: Side, material: str) -> Case:
    """Fill all openings of a side with one material; `open` leaves them empty."""
    facade = case.facade[side]
    strips = tuple(
        strip if strip.material == "wall" else strip.model_copy(update={"material": material})
        for strip in facade.strips
    )
    return case.with_facade(side, facade.model_copy(update={"strips": strips}))
