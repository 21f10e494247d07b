"""Tests by kind of evidence: unit (a folder for each room), system, validation, hard, bench."""

from pathlib import Path

import drcmitsuba  # noqa: F401  names LLVM before any test imports Mitsuba

ROOT = Path(__file__).resolve().parents[1]
REFERENCE = Path(__file__).parent / "reference"
"""Published numbers, and numbers of other programs."""
SHARED = ROOT.parent / "shared"
"""Weather, BSDFs and models of others, which are not part of the project; tests of them skip."""
