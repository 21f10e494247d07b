"""Words of the report, all in one table: `labels.toml`.

A translation is another file with the same keys.
"""

from __future__ import annotations

from functools import cache
from importlib import resources

from drcmitsuba.runtime.toml import tomllib


@cache
def labels() -> dict[str, str]:
    """Words by their key."""
    text = resources.files(__package__).joinpath("labels.toml").read_text(encoding="utf-8")
    return dict(tomllib.loads(text))
