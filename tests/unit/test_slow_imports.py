"""What takes long to import is imported by what uses it, not before."""

import subprocess
import sys

import pytest

ALL = (
    "drjit", "matplotlib", "mitsuba", "numpy", "pandas", "pvlib", "pydantic", "requests",
    "scipy", "shapely", "xarray", "zarr",
)  # fmt: skip
UNUSED_BY_AN_EVALUATION = ("matplotlib", "pvlib", "requests", "rich", "scipy", "zarr", "h5netcdf")
HELP = "sys.argv = ['drcmitsuba', '--help']; from drcmitsuba.cli import main; main.main()"


def imported(code, names):
    """Packages among `names` that a new process has imported after running the code."""
    ask = f"print(*(n for n in {names!r} if n in sys.modules), file=sys.stderr)"
    command = [sys.executable, "-c", f"import sys; {code}\n{ask}"]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    return run.stderr.split()


@pytest.mark.parametrize("code", ["import drcmitsuba", HELP])
def test_the_package_and_its_help_import_nothing_slow(code):
    assert imported(code, ALL) == []


def test_the_modules_of_an_evaluation_import_only_what_every_evaluation_uses():
    assert imported("import drcmitsuba.annual.result", UNUSED_BY_AN_EVALUATION) == []


def test_a_command_leaves_the_compiler_of_numpy_alone():
    start = "from drcmitsuba.cli import startup; startup.with_kernels(lambda: None)()"
    used = "import scipy.sparse, scipy.special"
    assert imported(f"{start}; {used}", ("numpy.f2py", "scipy.special")) == ["scipy.special"]


def test_a_command_leaves_chunks_of_arrays_alone_until_workers_want_them():
    start = "from drcmitsuba.cli import startup; startup.with_kernels(lambda: None)()"
    used = "import numpy, xarray; xarray.DataArray(numpy.zeros(3)).to_dataset(name='a').to_netcdf()"
    names = ("dask.array", "distributed", "xarray")
    assert imported(f"{start}; {used}", names) == ["xarray"]
    again = "from drcmitsuba.runtime import lazy; lazy.unhide('dask'); import distributed"
    assert imported(f"{start}; {used}; {again}", names[1:]) == ["distributed", "xarray"]


def test_the_sky_leaves_most_of_pvlib_alone():
    # xarray imports Dask's arrays, and these SciPy, wherever Dask is installed.
    no_dask = "sys.modules['dask.array'] = None"
    sky = "from drcmitsuba import weather; weather.default(); import drcmitsuba.sky.sun"
    assert imported(f"{no_dask}; {sky}", ("pvlib", "scipy", "requests")) == []


def test_the_report_draws_in_the_browser_and_imports_no_plots():
    assert imported("import drcmitsuba.report.document", ("matplotlib",)) == []


def test_a_picture_on_a_screen_imports_no_spectra():
    made = "picture.Picture(numpy.ones((2, 2, 3), 'float32'))"
    start = "import numpy; from drcmitsuba import picture; from drcmitsuba.picture import tone"
    assert imported(f"{start}; tone.human({made})", ("colour",)) == []
