"""`drcmitsuba bench`: a table on stdout, and nothing else."""

import pytest

from drcmitsuba.annual.bench import run as module
from drcmitsuba.export.programs import RadiancePrograms


@pytest.mark.parametrize("arguments", [(), ("--quick",)])
def test_the_table_is_all_that_is_printed(run, monkeypatch, arguments):
    asked = []
    row = module.Timed("ours", 0.1, module.CoefficientErrors(0.2, 0.1, 0.3, 1.0), 1_000_000)
    made = module.Bench({"sky": ((row,), "Reference.")}, ("A note.",))
    monkeypatch.setattr("drcmitsuba.annual.bench.bench", lambda *given: asked.append(given) or made)
    code, out, err = run("bench", *arguments)
    assert (code, err) == (0, "")
    assert asked[0][0] == (module.QUICK if arguments else module.WHOLE)
    assert out == made.markdown()


def test_a_weather_file_that_is_missing_is_refused_before_any_ray(refused, monkeypatch):
    monkeypatch.setattr(RadiancePrograms, "found", lambda: None)
    assert "nowhere.epw" in refused("bench", "--weather", "nowhere.epw")


def test_programs_on_the_path_come_before_those_of_the_package(monkeypatch):
    monkeypatch.setattr("shutil.which", lambda name: f"/usr/bin/{name}")
    assert RadiancePrograms.found() == RadiancePrograms(None)
    monkeypatch.setattr("shutil.which", lambda name: None)
    monkeypatch.setattr("drcmitsuba.export.programs.package_folder", lambda: None)
    assert RadiancePrograms.found() is None
