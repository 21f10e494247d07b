"""Design space of any case: of a room of boxes, or of a user's model."""

from __future__ import annotations

from typing import TypeAlias

from drcmitsuba.case.case import Case
from drcmitsuba.design.layout import Layout
from drcmitsuba.design.model_layout import ModelLayout

AnyLayout: TypeAlias = Layout | ModelLayout


def layout_of(case: Case) -> AnyLayout:
    """Read the layout from a case; errors are those of `Layout.of` and `ModelLayout.of`."""
    return Layout.of(case) if case.model is None else ModelLayout.of(case)
