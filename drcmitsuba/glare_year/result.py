"""Result of a year of glare: DGP of every hour and view, its shares of the hours, its class.

EN 17037 rates protection from glare by the DGP that is exceeded in at most 5 % of the occupied
hours [1]_: 0.35 for a high, 0.40 for a medium and 0.45 for a minimum protection. Hours of the
period without daylight are not counted: no sky and no sun is bright then.

References
----------
.. [1] EN 17037:2018, "Daylight in buildings", annexes A.5 and E.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.glare_year.state_doubts import StateDoubts, draws_of
from drcmitsuba.glare_year.worst_views import worst_spaces, worst_views
from drcmitsuba.metrics.intervals.autonomy import multipliers
from drcmitsuba.model.space import Space
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.scene.prepared_case import prepared

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CLASSES = {"high": 0.35, "medium": 0.40, "minimum": 0.45}
"""DGP that a class of EN 17037 allows to be exceeded in `EXCEEDED` of the hours."""
EXCEEDED = 0.05
"""Share of the occupied hours in which a class may be exceeded [–]."""
WRITTEN = re.compile(r"glare\.json|glare_(year|plan(_\d+)?)\.png")
"""Names of the files beside `glare.nc`."""
NONE = "none"
"""Class of a view that exceeds even the largest DGP for too long."""


@dataclass(frozen=True, eq=False)
class GlareYear:
    """Glare of a period; shows itself in Jupyter.

    Examples
    --------
    >>> import drcmitsuba
    >>> year = drcmitsuba.glare("desk.toml")
    >>> year.classes()["rating"].dims
    ('state', 'view')
    >>> figure = year.year_plot(view="desk", state="open")
    """

    case: Case
    hours: xr.Dataset
    """`dgp`, `dgp_se`, `illuminance`, `illuminance_se` [lx], `contrast` and, with films,
    `dgp_sharp`, (state, time, view), with the coordinates of the views; `daylight` (time,), 1
    where sky or sun is bright: these hours are counted, all of them without it."""
    replicates: np.ndarray
    """DGP by each replicate, float32, shape (replicate, state, time, view)."""
    settings: dict[str, Any]
    """Rule, case and weather, notes."""
    seconds: dict[str, float]
    """Seconds of the stages."""
    doubts: StateDoubts | None = None
    """Doubts about the last state, `applied`; None where there are none."""

    @property
    def states(self) -> tuple[str, ...]:
        """States of the façade; the last one may be `applied`."""
        return tuple(map(str, self.hours["state"].values))

    @property
    def views(self) -> tuple[str, ...]:
        """Names of the views."""
        return tuple(map(str, self.hours["view"].values))

    @cached_property
    def counted(self) -> np.ndarray:
        """Time stamps that shares count, indices: those with daylight; all, where none has any."""
        stamps = self.hours.sizes["time"]
        lit = self.hours["daylight"].values > 0 if "daylight" in self.hours else np.zeros(stamps)
        return np.flatnonzero(lit) if np.any(lit) else np.arange(stamps)

    @property
    def counting(self) -> str:
        """Hours that shares count, for people."""
        n, all_of = self._counted_hours
        of_period = "all of" if n == all_of else "those with daylight of"
        return f"{n:g} h, {of_period} the period's {all_of:g} h"

    @property
    def _counted_hours(self) -> tuple[float, float]:
        """Hours that shares count, and those of the period [h]."""
        step = float(self.hours.attrs.get("step_hours", 1.0))
        return step * len(self.counted), step * self.hours.sizes["time"]

    @cached_property
    def _drawn(self) -> tuple[dict[float, np.ndarray], np.ndarray]:
        """Share of the counted hours above each class' DGP by draw, and the hours in doubt.

        Shapes (state, view, draw), and bool (state, time, view).
        """
        replicates, states, times, views = self.replicates.shape
        drawn = multipliers(replicates, self.settings["seed"]).replicates
        out = {limit: np.zeros((states, views, drawn.shape[1])) for limit in CLASSES.values()}
        doubt = np.zeros((states, times, views), bool)
        dgp = self.hours["dgp"].transpose("state", "time", "view").values
        for s in range(states):
            for v in range(views):
                values = in_states = draws_of(self.replicates[:, s, self.counted, v], drawn)
                if self.doubts is not None and s == states - 1:
                    in_states = self.doubts.in_drawn_states(values, self.counted, v, drawn)
                for limit, shares in out.items():
                    above, stated = values > limit, dgp[s, self.counted, v] > limit
                    shares[s, v] = (in_states > limit).mean(axis=0)
                    doubt[s, self.counted, v] |= (above != stated[:, None]).any(axis=1)
        return out, doubt

    @property
    def in_doubt(self) -> np.ndarray:
        """Whether some draw of an hour's DGP lies beyond a limit that the DGP does not exceed, or
        the other way round, while the state of the façade stays, bool (state, time, view).

        The limits are those of `CLASSES`; the other hours add nothing to the intervals.
        """
        return self._drawn[1]

    def share(self, limit: float) -> xr.DataArray:
        """Share of the counted hours whose DGP is above a limit [–], dims (state, view)."""
        if not 0 < limit < 1:
            raise InputError("glare", "limit", f"{limit}", "give a DGP from 0 to 1")
        return (self.hours["dgp"].isel(time=self.counted) > limit).mean("time")

    def interval(self, limit: float) -> xr.Dataset:
        """Share of the counted hours whose DGP is above that of a class, with its 95 % interval.

        Parameters
        ----------
        limit : float
            DGP of a class, one of those of `CLASSES`.

        Returns
        -------
        xr.Dataset
            `value`, `low` and `high` [%], dims (state, view).
        """
        share = self.share(limit)
        low, high = np.quantile(self._drawn[0][limit], (0.025, 0.975), axis=-1)
        ends = {"low": np.minimum(share, low), "high": np.maximum(share, high)}
        return 100 * xr.Dataset({"value": share, **ends})

    def half_widths(self) -> np.ndarray:
        """Half the widest interval of the share of hours above a class' DGP [points].

        Returns
        -------
        np.ndarray, shape (state, view)
        """
        every = [self.interval(limit) for limit in CLASSES.values()]
        return np.max([(i["high"] - i["low"]).values / 2 for i in every], axis=0)

    def classes(self) -> xr.Dataset:
        """Class of EN 17037 of every view.

        Returns
        -------
        xr.Dataset
            `rating` (state, view), a name of `CLASSES` or "none", and `probability` of each of
            them, (state, view, class).
        """
        names = list(CLASSES)
        passes = np.stack([self.share(CLASSES[n]).values <= EXCEEDED for n in names], axis=-1)
        best = np.where(passes.any(axis=-1), passes.argmax(axis=-1), len(names))
        drawn = [(self._drawn[0][CLASSES[n]] <= EXCEEDED).mean(axis=-1) for n in names]
        # A class holds all that a better one asks for.
        chance = np.diff([np.zeros_like(drawn[0]), *drawn, np.ones_like(drawn[0])], axis=0)
        every = np.array([*names, NONE], object)
        at = {"state": self.hours["state"], "view": self.hours["view"].values, "class": every}
        return xr.Dataset(
            {
                "rating": (("state", "view"), every[best]),
                "probability": (("class", "state", "view"), chance),
            },
            at,
        ).transpose("state", "view", "class")

    def numbers(self) -> dict[str, Any]:
        """Content of `glare.json`: shares, classes and their probabilities by state and view.

        Where a case has several spaces, each view has the name of its `space`, "" in none, and
        `spaces` has the worst view of each by state, from `worst_views`; `storeys`, where there are
        several, and `building` have those by floor area, from `worst_spaces`.
        """
        rated = self.classes()
        every = {f"{c:.2f}": self.interval(c) for c in CLASSES.values()}
        by_state: dict[str, Any] = {}
        for s, state in enumerate(self.states):
            rows = by_state[state] = {}
            for v, view in enumerate(self.views):
                above = {
                    limit: {str(name): float(end[s, v]) for name, end in interval.items()}
                    for limit, interval in every.items()
                }
                chance = map(float, rated["probability"].values[s, v])
                rows[view] = {
                    "above": above,
                    "class": str(rated["rating"].values[s, v]),
                    "probability": dict(zip((*CLASSES, NONE), chance, strict=True)),
                    "largest": float(self.hours["dgp"].values[s, :, v].max()),
                }
                if "space" in self.hours.coords:
                    rows[view]["space"] = str(self.hours["space"].values[v])
        told: dict[str, Any] = {}
        if "space" in self.hours.coords:
            names = (*CLASSES, NONE)
            told = self._by_space({s: worst_views(rows, names) for s, rows in by_state.items()})
        step = float(self.hours.attrs.get("step_hours", 1.0))
        hours = {
            "period": step * self.hours.sizes["time"],
            "counted": step * len(self.counted),
            "which": self.counting,
        }
        return {
            "DGP": by_state, **told, "hours": hours, "settings": self.settings,
            "seconds": self.seconds,
        }  # fmt: skip

    def _by_space(self, worst: dict[str, dict[str, Any]]) -> dict[str, Any]:
        """Worst views by state and space, and with them those of storeys and of the building."""
        told: dict[str, Any] = {"spaces": worst}
        if not all(worst.values()):  # no view lies in a space
            return told
        classes = (*CLASSES, NONE)
        spaces = [s for s in prepared(self.case).spaces if s.name in next(iter(worst.values()))]
        storeys: dict[str, list[Space]] = {}
        for space in spaces:
            storeys.setdefault(space.storey, []).append(space)
        if len(storeys) > 1:
            told["storeys"] = {
                state: {name: worst_spaces(rows, own, classes) for name, own in storeys.items()}
                for state, rows in worst.items()
            }
        building = {state: worst_spaces(rows, spaces, classes) for state, rows in worst.items()}
        return told | {"building": building}

    def worst(self, state: str | None = None) -> str:
        """View with the most hours above the highest class' DGP in a state, by default the last."""
        state = self.states[-1] if state is None else state
        at = self.hours["dgp"].sel(state=state)
        return self.views[int((at > CLASSES["high"]).mean("time").argmax("view"))]

    def save(self, folder: str | Path, stage: Stage = silent) -> GlareYear:
        """Write `glare.nc`, `glare.json`, `glare_year.png` and `glare_plan.png` to a folder."""
        from drcmitsuba.report import plots

        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        with stage("writing"):
            storage.remove_others(folder, WRITTEN, ())  # of another run, if this one is stopped
            storage.save_netcdf(self.hours, folder / "glare.nc")
            storage.save_json(self.numbers(), folder / "glare.json")
            plots.save(self.year_plot(), folder / "glare_year.png")
            plots.save_all(self.plan_plots(), folder)
        return self

    def year_plot(self, view: str | None = None, state: str | None = None) -> Figure:
        """DGP over days and hours of a view, by default the worst one in the last state."""
        from drcmitsuba.report import glare_plots

        state = self.states[-1] if state is None else state
        view = self.worst(state) if view is None else view
        for name, known, text in (("view", self.views, view), ("state", self.states, state)):
            if text not in known:
                raise InputError("glare", name, repr(text), f"choose one of {', '.join(known)}")
        words = f"{self.case.name}: daylight glare probability, view {view}"
        words += f", façade {state}" if len(self.states) > 1 else ""
        return glare_plots.year(
            self.hours["dgp"].sel(state=state, view=view), title=words, caption=self._caption
        )

    def plan_plots(self, state: str | None = None) -> dict[str, Figure]:
        """Plans of the views with their shares of hours above 0.40 as arrows, by file name.

        Each storey with views has a plan.
        """
        from drcmitsuba.report import glare_plots
        from drcmitsuba.report.captions import turned_text
        from drcmitsuba.report.outlines import outlines_in_plan
        from drcmitsuba.report.sheets import sheets

        state = self.states[-1] if state is None else state
        h, limit = self.hours, CLASSES["medium"]
        share = 100 * self.share(limit).sel(state=state).values
        at = np.column_stack([h[axis].values for axis in "xy"])
        towards = np.column_stack([h[axis].values for axis in ("dx", "dy")])
        words = f"{self.case.name}: hours with DGP above {limit:.2f}"
        words += f", façade {state}" if len(self.states) > 1 else ""
        every = sheets(xr.Dataset(coords={axis: ("sensor", h[axis].values) for axis in "xyz"}))
        drawn = {}
        for k, sheet in enumerate(every, start=1):
            number = f"_{k}" if len(every) > 1 else ""
            where = f"; plan {k} of {len(every)}, eyes from {sheet.low:.2f} m on" * bool(number)
            views = sheet.sensors
            drawn[f"glare_plan{number}.png"] = glare_plots.plan(
                at[views], towards[views], share[views], title=words + where,
                caption=self._caption + turned_text(self.case),
                lines=outlines_in_plan(self.case, at[views], sheet),
                most=float(share.max(initial=0)),
            )  # fmt: skip
        return drawn

    @property
    def _caption(self) -> str:
        from drcmitsuba.report.captions import period_text

        weather = Path(self.settings["weather_source"]).name
        n, all_of = self._counted_hours
        every = f"; {n:g} h count, those with daylight of the period's {all_of:g} h" * (n != all_of)
        return f"{weather}; {period_text(self.case, self.hours)}{every}"

    def __repr__(self) -> str:
        size = f"{len(self.views)} views × {self.hours.sizes['time']} time stamps"
        return f"<GlareYear of {self.case.name!r}: {size}, worst view {self.worst()!r}>"

    def _repr_html_(self) -> str:
        """Table of the views in the last state, and the year of the worst one as a picture."""
        from html import escape

        from drcmitsuba.report import plots

        state, rows = self.states[-1], ""
        for view, row in self.numbers()["DGP"][state].items():
            shares = "".join(f"<td>{v['value']:.1f} %</td>" for v in row["above"].values())
            rows += f"<tr><th>{escape(view)}</th>{shares}<td>{row['class']}</td></tr>"
        limits = "".join(f"<th>above {limit:.2f}</th>" for limit in CLASSES.values())
        head = (
            f"<caption>{escape(self.case.name)}, façade {escape(state)}; {self.counting}</caption>"
        )
        head += f"<tr><th>view</th>{limits}<th>EN 17037</th></tr>"
        image = plots.html_image(self.year_plot(), "DGP over days and hours")
        return f"<table>{head}{rows}</table>{image}"
