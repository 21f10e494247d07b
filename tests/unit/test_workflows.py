"""Workflow files are read here: their services run them elsewhere."""

import re
from pathlib import Path

import pytest
import yaml

from drcmitsuba.runtime.toml import tomllib
from tests import ROOT

FILES = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
TEXTS = {path.name: path.read_text(encoding="utf-8") for path in FILES}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def jobs(name):
    return yaml.safe_load(TEXTS[name])["jobs"]


@pytest.mark.parametrize("name", TEXTS)
def test_every_job_has_a_machine_an_end_and_steps(name):
    for job in jobs(name).values():
        assert {"runs-on", "timeout-minutes", "steps"} <= set(job)
        for step in job["steps"]:
            assert ("uses" in step) != ("run" in step)
        axes = set(job.get("strategy", {}).get("matrix", {}))
        axes |= {key for row in job.get("strategy", {}).get("matrix", {}).get("include", [])
                 for key in row}  # fmt: skip
        assert {*re.findall(r"matrix\.(\w+)", yaml.safe_dump(job))} <= axes


def test_every_supported_python_and_system_is_run():
    matrix = jobs("tests.yml")["fast"]["strategy"]["matrix"]
    named = [
        line.rsplit(" ", 1)[1] for line in PROJECT["project"]["classifiers"] if ":: 3." in line
    ]
    assert matrix["python"] == named
    assert {system.split("-")[0] for system in matrix["system"]} == {"ubuntu", "macos", "windows"}


def test_what_workflows_run_is_there():
    for text in TEXTS.values():
        for module in re.findall(r"python -m (tests\.[\w.]+)", text):
            assert (ROOT / Path(*module.split("."))).with_suffix(".py").is_file()
    assert (ROOT / ".ci" / "run").is_file()
    bounds = next(p for p in PROJECT["project"]["dependencies"] if p.startswith("mitsuba"))
    assert bounds in TEXTS["tests.yml"]
    assert f"mitsuba=={re.search(r'>=([0-9.]+)', bounds)[1]}" in TEXTS["tests.yml"]
