"""Tests by kind of evidence: unit (a folder for each room), system, validation, hard, bench."""

from pathlib import Path

import drcmitsuba  # noqa: F401  names LLVM before any test imports Mitsuba

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"
"""Weather, BSDFs and reference tables that are not part of the project; tests without them skip."""
