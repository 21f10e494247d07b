"""Random façades put together from elements."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import drcmitsuba
from drcmitsuba.case.case import Case
from drcmitsuba.case.weather import PeriodTable
from drcmitsuba.sky.daylight import daylight
from tests.validation.calibration.rooms import WIDE
from tests.validation.fuzz.agreement import Sample, with_replicates
from tests.validation.fuzz.boxes import pane, random_box

TIMES = [f"2015-{day}T{hour:02d}:30" for day in ("01-20", "03-21", "06-21") for hour in (9, 12, 15)]
FOLDER = tempfile.TemporaryDirectory()  # until Python ends: samples are read late
MIRRORED = 0.1
"""Largest reflectance of glass: sums lack what two panes mirror in turn."""
FILLS = {"first": "one", "second": "two", "third": "third", "hole": "open"}
"""Materials of a façade, by the fills that are chosen: copies, so that no name is taken twice."""


def random_choice(rng: np.random.Generator) -> Sample:
    """Room of boxes each of whose openings may have another fill than the case draws."""
    case = with_replicates(random_box(rng))
    tables = case.model_dump(mode="json", include={"materials"})["materials"]
    tables["third"] = pane(rng)
    for table in tables.values():
        if table["type"] == "glazing":
            table["reflectance"] = min(table["reflectance"], MIRRORED)
    tables |= {"one": tables["first"], "two": tables["second"]}
    case = Case.model_validate(
        case.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
        | {"materials": tables, "outside": {"sun_diameter": WIDE}}
    )
    openings = [
        (side, strip.material) for side, facade in case.facade.items() for strip in facade.strips
    ]
    chosen = {opening: str(rng.choice([*FILLS])) for opening in openings if rng.random() < 0.7}
    facade = {
        side: one.model_copy(update={"strips": tuple(
            strip.model_copy(update={"material": FILLS[chosen[side, strip.material]]})
            if (side, strip.material) in chosen else strip
            for strip in one.strips
        )})
        for side, one in case.facade.items()
    }  # fmt: skip
    case = at_times(case)

    def light() -> np.ndarray:
        elements = drcmitsuba.elements(case, ["hole", "one", "two", "third"])
        choice = {
            f"{material} ({side})": "hole" if FILLS[fill] == "open" else FILLS[fill]
            for (side, material), fill in chosen.items()
        }
        made = elements.evaluate(choice)
        return np.asarray(made.coefficients["replicates"].isel(state=0).values)

    return Sample(case.with_tables(facade=facade), daylight(case).suns, light)


def at_times(case: Case) -> Case:
    """The case at few time stamps, whose suns shine from many directions."""
    file = Path(FOLDER.name) / "times.csv"
    file.write_text("time\n" + "\n".join(TIMES) + "\n")
    return case.with_tables(period=PeriodTable(timestamps=str(file)))
