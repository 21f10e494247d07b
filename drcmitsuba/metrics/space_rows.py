"""The attribute `spaces` of C and E: a list of rows, one for each space of a case."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from drcmitsuba.runtime.errors import InputError

DAMAGED = (ValueError, TypeError, LookupError, ArithmeticError, AttributeError, RecursionError)
"""Errors of reading a list of spaces that is none."""
T = TypeVar("T")


def read_rows(attributes: Mapping[Any, Any], read: Callable[[Mapping[str, Any]], T]) -> list[T]:
    """Read every row of the attribute `spaces`; none without it.

    Raises
    ------
    InputError
        The attribute is no list of spaces.
    """
    try:
        return [read(row) for row in json.loads(str(attributes.get("spaces", "[]")))]
    except DAMAGED as error:
        remedy = "compute the illuminance anew"
        raise InputError("illuminance", "spaces", f"{error}"[:120], remedy) from None
