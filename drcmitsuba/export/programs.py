"""The programs of Radiance on this machine: those on the PATH, or of the package `pyradiance`."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from drcmitsuba.runtime.errors import InputError, on_a_line

NEEDED = ("oconv", "rcontrib")
"""Programs without which there are no coefficients."""
INSTALL = "pip install pyradiance"


def package_folder() -> Path | None:
    """Folder of the package `pyradiance`; None where it is not installed."""
    spec = importlib.util.find_spec("pyradiance")
    if spec is None or not spec.submodule_search_locations:
        return None
    return Path(spec.submodule_search_locations[0])


@dataclass(frozen=True)
class RadiancePrograms:
    """Where the programs of Radiance and its function files are.

    Parameters
    ----------
    package : Path or None
        Folder of `pyradiance`; None for the programs on the PATH, which find their files.
    """

    package: Path | None

    @classmethod
    def found(cls) -> RadiancePrograms | None:
        """Find the user's own programs, which may be built for the machine, else the package's."""
        if all(map(shutil.which, NEEDED)):
            return cls(None)
        package = package_folder()
        return None if package is None else cls(package)

    @property
    def where(self) -> str:
        """Words on where they come from."""
        return "on the PATH" if self.package is None else "of pyradiance"

    def run(
        self, command: Sequence[str], folder: Path, stdin: bytes = b"",
        timeout: float | None = None,
    ) -> bytes:  # fmt: skip
        """Run a program in a folder and return what it writes on stdout.

        Raises
        ------
        InputError
            It fails: its first line on stderr, and the command.
        subprocess.TimeoutExpired
            It takes longer than so many seconds.
        """
        environment = dict(os.environ)
        if self.package is not None:
            path = [str(self.package / "bin"), environment.get("PATH", "")]
            environment["PATH"] = os.pathsep.join(path)
            environment["RAYPATH"] = os.pathsep.join([".", str(self.package / "lib")])
        done = subprocess.run(
            command, cwd=folder, input=stdin, env=environment, capture_output=True,
            timeout=timeout, check=False,
        )  # fmt: skip
        if done.returncode:
            got = on_a_line(done.stderr.decode(errors="replace")) or f"exit code {done.returncode}"
            raise InputError(" ".join(command), "Radiance", got, f"check it, or {INSTALL}")
        return done.stdout

    def version(self) -> str:
        """Version of Radiance, as `rcontrib` gives it."""
        return self.run(["rcontrib", "-version"], Path()).decode().strip()
