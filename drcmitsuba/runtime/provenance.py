"""One answer to what made a number: its inputs, the method, the libraries and the variant.

Blocks of coefficients, light paths of pictures, rows of a study and coefficients of an earlier run
are used where all of it is the same. What another program made of the same inputs is told apart
from what was made of others, so that the user hears why it is made again.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi

from drcmitsuba.runtime import backend
from drcmitsuba.runtime.content_key import content_key

METHOD = 28
"""Version of the method by which numbers are computed; those of another one are not used."""
PROGRAM_DIGITS = 8
"""Number of hexadecimal digits of a key that stand for the program."""


def program() -> dict[str, str]:
    """Program that computes numbers: its method, libraries and the variant of Mitsuba.

    Raises
    ------
    BackendError
        No fit LLVM or GPU.
    """
    return {
        "method": str(METHOD), "mitsuba": mi.__version__, "drjit": dr.__version__,
        "variant": backend.select(),
    }  # fmt: skip


@dataclass(frozen=True)
class Provenance:
    """Inputs and program of a stored number."""

    inputs: str
    """Digest of the inputs, the contents of files included."""
    program: str
    """Digest of the program."""

    @classmethod
    def of(cls, *inputs: Any, release: str = "") -> Provenance:
        """Provenance of a number that this program makes of inputs, as `content_key` takes them.

        A number that a new release may change though its method is the same states its `release`.

        Raises
        ------
        TypeError
            The content of an input is unknown.
        """
        return cls(content_key(*inputs), content_key(program(), release)[:PROGRAM_DIGITS])

    @property
    def key(self) -> str:
        """Name of files and folders."""
        return f"{self.inputs}-{self.program}"


@dataclass(frozen=True)
class StoredKeys:
    """Keys of what a folder holds."""

    keys: frozenset[str]

    @classmethod
    def of(cls, folder: Path) -> StoredKeys:
        """List the keys of a folder, which need not exist."""
        return cls(frozenset(path.name.partition(".")[0] for path in folder.glob("*-*")))

    @cached_property
    def _inputs(self) -> frozenset[str]:
        return frozenset(key.partition("-")[0] for key in self.keys)

    def are_of_another_program(self, made: Provenance) -> bool:
        """Whether they hold what another program made of the same inputs, and nothing of this."""
        return made.inputs in self._inputs and made.key not in self.keys
