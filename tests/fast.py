"""Tests that take no time: `pytest -m fast` runs them in less than three minutes.

A test is `fast` unless it is `slow` or its file is named here. A file is named where its tests take
more than some three seconds together (`--durations=0`); a folder, where most of its files do.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

from tests import ROOT

TESTS = ROOT / "tests"
LONG = (
    "hard", "system", "validation",
    "unit/bsdf/test_bsdf_check.py",
    "unit/design/test_change.py",
    "unit/design/test_design_film.py",
    "unit/design/test_design_parameters.py",
    "unit/design/test_design_reflectances.py",
    "unit/design/test_facade_groups.py",
    "unit/design/test_facade_year.py",
    "unit/design/test_interior_of_models.py",
    "unit/design/test_optimise.py",
    "unit/design/test_tilt.py",
    "unit/eye",
    "unit/glare_year",
    "unit/goniophotometer/test_goniophotometer.py",
    "unit/metrics/test_more_metrics.py",
    "unit/model/test_ifc.py",
    "unit/plan/test_forecast.py",
    "unit/plugins/test_coefficient.py",
    "unit/plugins/test_photon_map.py",
    "unit/plugins/test_redirecting_film.py",
    "unit/rendering",
    "unit/report/test_plots.py",
    "unit/runtime/test_backend.py",
    "unit/scene/test_facade_structures.py",
    "unit/scene/test_prepared_case.py",
    "unit/standards/test_standards.py",
    "unit/test_skips.py",
    "unit/transport/test_cells_and_transfer.py",
    "unit/transport/test_coefficients_exact.py",
    "unit/transport/test_coefficients_small_room.py",
    "unit/transport/test_gather.py",
    "unit/transport/test_groups_of_rooms.py",
    "unit/transport/test_interior.py",
    "unit/transport/test_known_year.py",
    "unit/transport/test_light_by_element.py",
    "unit/transport/test_light_paths.py",
    "unit/transport/test_model_exits.py",
    "unit/transport/test_pane_ports.py",
    "unit/transport/test_photon_scene.py",
    "unit/transport/test_photons.py",
    "unit/transport/test_shared_photons.py",
    "unit/transport/test_two_sided_walls.py",
)  # fmt: skip
"""Files and folders of `tests` whose tests take longer."""
SHORT = (
    "hard/test_hard_sums.py", "system/test_case_command.py", "system/test_elements.py",
    "system/test_plan_command.py",
)  # fmt: skip
"""Files in those folders whose tests take no longer."""


def slowly(values: Iterable[Any], *slow: Any) -> list[Any]:
    """Parameters of a test, some of which only run at night."""
    return [pytest.param(v, marks=[pytest.mark.slow] * (v in slow), id=str(v)) for v in values]


def is_long(path: str) -> bool:
    """Whether a file, by its path in `tests`, is left out."""
    within = (path == name or path.startswith(f"{name}/") for name in LONG)
    return path not in SHORT and any(within)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is fast, before pytest selects by marks."""
    for item in items:
        path = item.path
        is_ours = path.is_relative_to(TESTS) and item.get_closest_marker("slow") is None
        if is_ours and not is_long(path.relative_to(TESTS).as_posix()):
            item.add_marker("fast")
