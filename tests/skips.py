"""Skipped tests lack something. A run counts skips; one that lacks nothing of these fails it.

`conftest` takes the two hooks at the end. Of several processes the one that reports counts.
"""

from __future__ import annotations

import importlib.util
import os
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

import pytest

from tests import SHARED
from tests.browser import CHROMIUM


@dataclass(frozen=True)
class Lack:
    """Something that a machine may lack without fault, so that tests of it are skipped."""

    words: str
    """Reason of the skips, which a colon and what is lacking in particular may follow."""
    why: str
    """Reason why a run without it is a run nevertheless."""
    is_so: Callable[[], bool]
    """Whether this machine lacks it: a skip is not expected where it does not."""

    def reason(self, which: object = "") -> str:
        return f"{self.words}: {which}" if which else self.words

    def skip(self, which: object = "") -> NoReturn:
        """Skip the test, or the file that is imported."""
        pytest.skip(self.reason(which), allow_module_level=True)

    def skip_if_so(self) -> None:
        if self.is_so():
            self.skip()

    @property
    def mark(self) -> pytest.MarkDecorator:
        return pytest.mark.skipif(self.is_so(), reason=self.words)


def _module(name: str, why: str) -> Lack:
    return Lack(f"no {name}", why, lambda: importlib.util.find_spec(name) is None)


def _is_root() -> bool:
    return hasattr(os, "geteuid") and os.geteuid() == 0


def _has_no_llvm() -> bool:
    from drcmitsuba.runtime import backend

    return backend.llvm_version() is None


DATA = Lack(
    "no shared data",
    "weather, BSDFs, models and pictures of others are not part of the project",
    lambda: not SHARED.is_dir(),
)
RADIANCE = _module("pyradiance", "Radiance is the second opinion; not all platforms have it")
MODULES = {
    "pyradiance": RADIANCE,
    "atheris": _module("atheris", "it is the optional extra `fuzz`"),
    "axe_core_python": _module("axe_core_python", "it judges pages in a browser alone"),
    "distributed": _module("distributed", "it is the optional extra `cluster`"),
    "ifcopenshell": _module("ifcopenshell", "it is the optional extra `ifc`"),
    "pyarrow": _module("pyarrow", "one format of the tables of studies needs it"),
}
BROWSER = Lack("no Chromium", "the report is drawn without a browser", lambda: CHROMIUM is None)
LLVM = Lack("no LLVM", "kernels run on the GPU alone", _has_no_llvm)
UNFIT_LLVM = Lack("no unfit LLVM", "few machines have an LLVM that is too old", lambda: True)
POSIX = Lack("no POSIX", "signals, forks, shells and folders are others", lambda: os.name == "nt")
PROC = Lack(
    "no /proc", "signs of a process are read there", lambda: not Path("/proc/self").exists()
)
PICTURES = Lack(
    "no Matplotlib 3.11",
    "pictures were kept from it; older ones, the last for Python 3.10, set letters otherwise",
    lambda: tuple(map(int, version("matplotlib").split(".")[:2])) < (3, 11),
)
ORDINARY_USER = Lack("no ordinary user", "root may read and write everything", _is_root)
LACKS = (
    DATA, *MODULES.values(), BROWSER, LLVM, UNFIT_LLVM, POSIX, PROC, PICTURES, ORDINARY_USER,
)  # fmt: skip


def data(path: Path) -> Path:
    """Path of shared data; without it, the test is skipped."""
    if not path.exists():
        DATA.skip(path.relative_to(SHARED))
    return path


def needs(path: Path) -> pytest.MarkDecorator:
    """Mark of tests of shared data."""
    reason = DATA.reason(path.relative_to(SHARED))
    return pytest.mark.skipif(not path.exists(), reason=reason)


def module(name: str) -> ModuleType:
    """Import an optional module; without it, the test or the file is skipped."""
    imported: ModuleType = pytest.importorskip(name, reason=MODULES[name].words)
    return imported


def lack_of(reason: str) -> Lack | None:
    """Find the lack that a skip's reason names; None where it is not expected."""
    named = (lack for lack in LACKS if reason.split(":")[0] == lack.words)
    return next((lack for lack in named if lack.is_so()), None)


def _reasons(reporter: Any) -> Counter[str]:
    """Number of skips by their reason; a file that is skipped whole is one."""
    found: Counter[str] = Counter()
    for report in reporter.stats.get("skipped", []):
        told = report.longrepr
        words = told[2] if isinstance(told, tuple | list) else str(told)
        found[words.removeprefix("Skipped: ")] += 1
    return found


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail a run with a skip that is not expected."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or session.exitstatus != pytest.ExitCode.OK:
        return
    if any(lack_of(reason) is None for reason in _reasons(reporter)):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print the number of skips by what they lack."""
    expected: Counter[Lack] = Counter()
    others: Counter[str] = Counter()
    for reason, count in _reasons(terminalreporter).items():
        lack = lack_of(reason)
        if lack is None:
            others[reason] += count
        else:
            expected[lack] += count
    if not expected and not others:
        return
    terminalreporter.section("skipped")
    for lack, count in expected.most_common():
        terminalreporter.line(f"{count:5} {lack.words} ({lack.why})")
    for reason, count in others.most_common():
        terminalreporter.line(f"{count:5} {reason} (not expected: fails the run)", red=True)
