"""What was compiled is counted by stage, and said once."""

import os
import subprocess
import sys

import pytest

from drcmitsuba.runtime.compilation import Compilation
from tests import skips

LAUNCHES = """
import drjit as dr, mitsuba as mi
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.compilation import recorded
from drcmitsuba.runtime.progress import silent

backend.select()
with recorded(silent) as (stage, compilation):
    for name in ("rays", "again"):
        with stage(name):
            dr.eval(dr.sin(dr.arange(mi.Float, 100)))
print(compilation.kernels, compilation.seconds > 0, dr.flag(dr.JitFlag.KernelHistory))
"""


@skips.POSIX.mark
def test_the_first_run_counts_the_kernels_that_it_compiles_and_the_second_has_none(tmp_path):
    said = [
        subprocess.run(
            [sys.executable, "-c", LAUNCHES], env=os.environ | {"HOME": str(tmp_path)},
            capture_output=True, text=True, check=True,
        ).stdout.strip()
        for _ in range(2)
    ]  # fmt: skip
    assert said == ["{'rays': 1} True False", "{} False False"]


@pytest.mark.parametrize(("seconds", "said"), [(0.1, False), (7.4, True)])
def test_the_line_names_kernels_seconds_and_stages(seconds, said):
    line = Compilation({"forecast": 48, "open façade": 32}, seconds).line()
    assert bool(line) == said
    if said:
        assert line.startswith("compiled 80 kernels in 7.4 s (forecast 48, open façade 32);")
