"""The version of the program: the tag of the release, which the package's metadata hold."""

from __future__ import annotations

from importlib import metadata

try:
    RELEASE = metadata.version("drcmitsuba")
except metadata.PackageNotFoundError:  # a source tree that was never installed
    RELEASE = "0+unknown"
