"""One façade of the report: an evaluation from a folder, or a result in memory."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba import standards
from drcmitsuba.case.case import Case
from drcmitsuba.metrics.evaluate_metrics import settings_of
from drcmitsuba.report.document.light_of_sensors import light_of_sensors
from drcmitsuba.report.document.stored_lights import stored_lights
from drcmitsuba.report.document.stored_pictures import (
    StoredGlare,
    older_pictures,
    stored_glare,
)
from drcmitsuba.report.metrics_file import case_of, read_numbers
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.schema import luminance
from drcmitsuba.standards import Evidence, Refusal, Verdict
from drcmitsuba.standards.evidence import Evaluated

LARGEST_PLAN = 1 << 20
"""Largest `plan.json` that is read [bytes]."""
MOST_EFFECTS = 60
"""Largest number of effects that are shown."""
EVALUATE = "give a folder of drcmitsuba evaluate -o"
"""Advice on folders that hold no evaluation."""
OF_METRICS = ("metrics", "variant", "notes")
"""Settings in which metrics.json may differ from the illuminance: thresholds are chosen anew."""


@dataclass(frozen=True, eq=False)
class EvaluatedFacade:
    """Evaluation of one façade, as the report shows it."""

    case: Case
    illuminance: xr.Dataset
    """E by luminance, `total` and `direct_sun` (time, sensor) [lx], with all coordinates."""
    numbers: dict[str, Any]
    """Content of `metrics.json`."""
    plan: dict[str, dict[str, Any]]
    """Content of `plan.json`; empty where the steps were run one by one."""
    verdicts: list[Verdict | Refusal]
    fingerprint: str = ""
    """Digest of the inputs; empty where C is missing."""
    notes: tuple[str, ...] = ()
    """Remarks on what the report cannot show."""
    folder: Path | None = None
    """Folder in which pictures may stand."""
    lights: xr.Dataset | None = None
    """Light of some points by where it comes from."""
    light_of_sensors: xr.Dataset | None = None
    """The same of all points, without their sky domes."""
    glare: StoredGlare | None = None
    """Glare of views, by state of the façade."""

    @property
    def settings(self) -> dict[str, Any]:
        """Origin of the result: its case, weather, notes."""
        return dict(self.numbers["settings"])

    @property
    def step_hours(self) -> float:
        """Length of the interval of a time stamp [h]."""
        return float(self.illuminance.attrs.get("step_hours", 1.0))

    @classmethod
    def of_folder(cls, folder: str | Path) -> Callable[[], EvaluatedFacade]:
        """Read the files of `evaluate -o FOLDER`; C, L and the plan may be missing.

        So may `lights.nc`, `light_of_sensors.nc` and `glare.json`, which other commands add.

        Returns
        -------
        callable
            Judges what has been read, which another thread may do, and returns the façade.

        Raises
        ------
        InputError
            A file is missing or damaged, of another version, or of another evaluation.
        """
        folder = Path(folder)
        if not folder.is_dir():
            got = "no such folder"
            raise InputError(folder, "results", got, EVALUATE)
        evidence = Evidence.of_folder(folder)
        path = folder / "metrics.json"
        numbers = read_numbers(path, evidence.illuminance.sizes["sensor"])
        case, error = case_of(numbers, path)
        _check_same(path, numbers["settings"], evidence, case)
        notes: tuple[str, ...] = ()
        if error is not None:  # its text may quote a file that is not for the report's readers
            notes = ("the plans have no rooms, since the model's files cannot be read here",)
        plan = _plan(folder / "plan.json")
        lights = stored_lights(folder, evidence.illuminance)
        glare, of_glare = stored_glare(folder, numbers["settings"])
        notes += of_glare + older_pictures(folder)
        of_all = light_of_sensors(folder, evidence.illuminance)
        return lambda: replace(
            cls._judged(case, evidence, numbers, plan, notes),
            folder=folder, lights=lights, light_of_sensors=of_all, glare=glare,
        )  # fmt: skip

    @classmethod
    def of_result(
        cls, result: Evaluated, numbers: dict[str, Any], plan: dict[str, Any]
    ) -> EvaluatedFacade:
        """Take a result in memory, with its metrics and its plan."""
        evidence = Evidence.of_result(result)
        plain = json.loads(json.dumps([numbers, plan], default=str))
        return cls._judged(result.case, evidence, plain[0], _effects(plain[1]))

    @classmethod
    def _judged(
        cls, case: Case, evidence: Evidence, numbers: dict[str, Any],
        plan: dict[str, dict[str, Any]], notes: tuple[str, ...] = (),
    ) -> EvaluatedFacade:  # fmt: skip
        E = evidence.illuminance
        light = {name: luminance(E[name]) for name in ("total", "direct_sun")}
        seen = xr.Dataset(light, coords=E.coords, attrs=E.attrs)  # states of groups have other dims
        for name, values in seen.data_vars.items():
            if np.isnan(values.values).any():
                got = f"{name} is not known everywhere"
                raise InputError(evidence.source, "illuminance", got, "evaluate the case again")
        C = evidence.coefficients
        fingerprint = "" if C is None else str(C.attrs.get("fingerprint", ""))
        return cls(case, seen, numbers, plan, standards.verdicts(evidence), fingerprint, notes)


def _check_same(path: Path, settings: dict[str, Any], evidence: Evidence, case: Case) -> None:
    """Refuse metrics of another evaluation than that of the illuminance."""
    of_light = settings_of(evidence.illuminance.attrs, evidence.source, case.metrics)
    for key, value in of_light.items():
        if key not in OF_METRICS and settings.get(key) != value:
            got = "it is of another evaluation than illuminance.nc"
            raise InputError(path, f"settings, {key}", got, "evaluate the case again")


def _plan(path: Path) -> dict[str, dict[str, Any]]:
    """Read `plan.json`; empty where there is none.

    Raises
    ------
    InputError
        It is no JSON object of effects, or too large.
    """
    if not path.exists():
        return {}
    remedy = "run evaluate again"
    plan = storage.load_json(path, "plan", LARGEST_PLAN, remedy)
    if not (isinstance(plan, dict) and all(isinstance(e, dict) for e in plan.values())):
        raise InputError(path, "plan", "no table of effects", remedy)
    return _effects(plan)


def _effects(plan: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return dict(list(plan.items())[:MOST_EFFECTS])
