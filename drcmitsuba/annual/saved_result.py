"""Results of an evaluation share this: they save themselves and show themselves in Jupyter."""

from __future__ import annotations

import json
import re
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import xarray as xr

from drcmitsuba.annual.attributes import settings
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.plan import Plan, light_notes
from drcmitsuba.plan.forecast import Forecast
from drcmitsuba.runtime import backend, storage
from drcmitsuba.runtime.background import beside
from drcmitsuba.runtime.byte_size import size_on_disk
from drcmitsuba.runtime.folder_lock import locked
from drcmitsuba.runtime.machine_memory import peak_memory
from drcmitsuba.runtime.progress import Progress, Stage, part, rough, silent
from drcmitsuba.scene.enabled_effects import EnabledEffects

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from drcmitsuba.report.standing import DrawnParts

ALL_ARRAYS = {
    "illuminance.nc", "coefficients.zarr", "sky.zarr", "year.zarr", "sensors.nc", "colour.nc",
}  # fmt: skip
"""Files of arrays of all kinds of results."""
DRAWN = re.compile(
    r"(illuminance|autonomy|sun|melanopic|undecided_(sda|ase))(_\d+)?_plan\.png"
    r"|illuminance_(mountain(_\d+)?|section(_\d+)?|year(_\d+)?)\.png|(monthly|sun_path)\.png"
)
"""Names of the pictures of an evaluation, those of `plot` among them."""

Own = TypeVar("Own", bound="SavedResult")


class SavedResult(ABC):
    """Result of an evaluation: a frozen dataclass with the fields below."""

    case: Case
    metrics: dict[str, Any]
    plan: dict[str, Any]
    enabled_effects: EnabledEffects

    @property
    @abstractmethod
    def described(self) -> xr.Dataset:
        """Array with the time stamps, the sensors and the attributes of E."""

    @abstractmethod
    def _arrays(self, folder: Path) -> dict[str, Callable[[], None]]:
        """Functions that write the files of arrays to a folder, by name."""

    @abstractmethod
    def _pictures(self) -> dict[str, Figure]:
        """Draw all pictures, by file name."""

    def save(
        self: Own, folder: str | Path, stage: Stage = silent, drawn: DrawnParts | None = None
    ) -> Own:
        """Write all results and plots to a folder, each file whole or not at all.

        Parameters
        ----------
        folder : str or Path
        stage : callable, optional
        drawn : DrawnParts, optional
            Parts that the pictures of another result had in common with those of this one.

        Returns
        -------
        SavedResult
            The same result, with the seconds and bytes of writing in `metrics` and `plan`.

        Raises
        ------
        InputError
            Another process writes to the folder.
        """
        folder = Path(folder)
        with locked(folder):
            return self._saved(folder, stage, drawn)

    def _saved(self: Own, folder: Path, stage: Stage, drawn: DrawnParts | None) -> Own:
        """Write all files to a folder that other processes leave alone."""
        start = time.perf_counter()
        for name in ("metrics.json", "plan.json", "compliance.json"):  # none is that of new arrays
            (folder / name).unlink(missing_ok=True)
        arrays = self._arrays(folder)
        for name in ALL_ARRAYS.difference(arrays):  # of an earlier evaluation
            storage.remove(folder / name)
        with stage("writing") as done:
            with beside(*arrays.values()):
                pictures = self._save_pictures(folder, part(done, 0.0, 0.9), drawn)
            elapsed = round(time.perf_counter() - start, 3)
            seconds = self.metrics["seconds"] | {"writing": elapsed}
            metrics = self.metrics | {"seconds": seconds, "peak_memory_bytes": peak_memory()}
            storage.save_json(metrics, folder / "metrics.json")
            names = (*arrays, "metrics.json", *pictures)
            disk = sum(size_on_disk(folder / name) for name in names)
            cost = with_actual(self.plan["cost"], metrics, {"disk_bytes": disk})
            saved = replace(self, metrics=metrics, plan=self.plan | {"cost": cost})  # type: ignore[type-var]
            storage.save_json(saved.plan, folder / "plan.json")
        return saved

    def without_pictures(self: Own, reason: str) -> Own:
        """The same result, whose folder has no pictures for a reason that its plan states."""
        plan = self.plan | {"pictures": {"on": False, "reason": reason}}
        effects = replace(self.enabled_effects, pictures=False)
        return replace(self, plan=plan, enabled_effects=effects)  # type: ignore[type-var]

    def _save_pictures(
        self, folder: Path, progress: Progress, parts: DrawnParts | None
    ) -> list[str]:
        """Draw the plots, remove those of an earlier evaluation, and return the file names."""
        drawn = {}
        if self.enabled_effects.pictures:
            from drcmitsuba.report import plots

            drawn = self._pictures()
            plots.save_all(drawn, folder, progress, parts)
        storage.remove_others(folder, DRAWN, drawn)
        return list(drawn)

    def __repr__(self) -> str:
        E = self.described
        numbers = ", ".join(f"{name} {_text(self.metrics[name])}" for name in ("sDA", "ASE"))
        size = f"{E.sizes['time']} time stamps × {E.sizes['sensor']} sensors"
        return f"<{type(self).__name__} of {self.case.name!r}: {numbers}; {size}>"

    def _repr_html_(self) -> str:
        """Table of the metrics with their 95 % intervals, and the months as a picture."""
        from html import escape

        from drcmitsuba.report import figures, plots

        figure = figures.monthly(self.case, self.described, self.metrics)
        rows = "".join(
            f"<tr><th>{name.replace('_', ' ')}</th><td>{_text(self.metrics[name])}</td></tr>"
            for name in ("sDA", "ASE", "shade_closed")
        )
        if "melanopic" in self.metrics:
            light = _text(self.metrics["melanopic"]["autonomy"])
            rows += f"<tr><th>melanopic autonomy</th><td>{light}</td></tr>"
        remarks = "".join(f"<p>{escape(n)}</p>" for n in self.metrics["settings"]["notes"])
        image = plots.html_image(figure, "metrics by month")
        head = f"<caption>{escape(self.case.name)}, 95 % intervals</caption>"
        return f"<table>{head}{rows}</table>{image}{remarks}"


def _text(number: Mapping[str, float]) -> str:
    """Write a metric and its interval [%]."""
    return f"{number['value']:.1f} % ({number['low']:.1f} … {number['high']:.1f})"


def with_actual(
    cost: Mapping[str, Any], metrics: Mapping[str, Any], more: Mapping[str, Any]
) -> dict[str, Any]:
    """Entry `cost` of a plan, with the actual cost beside the forecast; `more`: rays, bytes."""
    actual = {
        **cost.get("actual", {}),
        "seconds": round(sum(metrics["seconds"].values()), 3),
        "memory_bytes": metrics["peak_memory_bytes"],
        **more,
    }
    reason = f"took {rough(actual['seconds'])} s"
    if "forecast" in cost:
        reason = f"forecast {rough(cost['forecast']['seconds'])} s; {reason}"
    if "rays" in actual:
        reason += f" and {sum(actual['rays'].values())} rays"
    return {**cost, "actual": actual, "reason": reason}


def with_record(
    planned: Plan, numbers: Mapping[str, Any], attributes: Mapping[str, Any], run: Run,
    remarks: list[str], expected: Forecast | None,
) -> tuple[dict[str, Any], dict[str, Any]]:  # fmt: skip
    """Contents of `metrics.json` and `plan.json`: numbers with their origin, plan with its cost.

    `attributes` are those of C, `remarks` the notes on films and shade.
    """
    case, light = planned.facts.case, planned.facts.light
    damaged = [] if run.blocks is None else run.blocks.notes
    every = (light.notes, remarks, planned.notes(), light_notes(attributes), damaged)
    known = attributes.get("settings")
    origin = (json.loads(known) if known else settings(case, light)) | {"variant": backend.select()}
    metrics = {
        **numbers,
        "settings": {**origin, "notes": [note for notes in every for note in notes]},
        "seconds": dict(run.seconds),
        "peak_memory_bytes": peak_memory(),
    }
    effects = planned.to_dict(attributes)
    if expected is None:
        effects["cost"] = {"on": True, "reason": "no forecast"}
    else:
        effects = expected.beside(effects)
    rays = {"rays": dict(run.ray_counter)} if run.ray_counter else {}
    return metrics, effects | {"cost": with_actual(effects["cost"], metrics, rays)}
