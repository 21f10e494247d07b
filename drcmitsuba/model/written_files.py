"""Files that a reading writes for the length of the process: BSDFs within models, and made ones."""

from __future__ import annotations

import hashlib
import re
import tempfile
from functools import lru_cache
from pathlib import Path


@lru_cache(maxsize=1)
def _folder() -> tempfile.TemporaryDirectory[str]:
    """Folder of this process, which is removed at its end."""
    return tempfile.TemporaryDirectory(prefix="drcmitsuba_")


def written(content: bytes, name: str) -> Path:
    """Write a file for the length of this process; its folder is named by its content."""
    folder = Path(_folder().name) / hashlib.sha256(content).hexdigest()[:16]
    folder.mkdir(exist_ok=True)
    path = folder / f"{re.sub('[^A-Za-z0-9_-]', '_', name)[:60]}.xml"
    path.write_bytes(content)
    return path
