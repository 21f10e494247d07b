"""Signs that an output's encoding lacks are written as near ones: 2.0 ≤ 3 as 2.0 <= 3.

Files and pipes have the encoding of the system, on Windows often one of 256 signs. Python would end
a command there by an error.
"""

from __future__ import annotations

import codecs
import unicodedata
from contextlib import suppress
from typing import TextIO

NEAR = {
    "−": "-", "–": "-", "≤": "<=", "≥": ">=", "×": "x", "·": "*", "≈": "~", "±": "+/-", "°": " deg",
    "→": "->", "✓": "yes", "✗": "no", "θ": "theta", "φ": "phi", "ø": "o", "ß": "ss",
}  # fmt: skip
"""Near signs of ASCII where Unicode does not name them."""
ERRORS = "drcmitsuba.near"


def near(sign: str) -> str:
    """Near sign of ASCII: a letter without its accent; the sign's number where none is near."""
    if sign in NEAR:
        return NEAR[sign]
    parts = unicodedata.normalize("NFKD", sign).encode("ascii", "ignore").decode()
    return parts or ascii(sign)[1:-1]


def _replaced(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(near, error.object[error.start : error.end])), error.end


codecs.register_error(ERRORS, _replaced)


def allow(*streams: TextIO) -> None:
    """Have text streams write near signs in place of those that their encoding lacks."""
    for stream in streams:
        with suppress(AttributeError, ValueError):  # a stream of someone else's, or a closed one
            stream.reconfigure(errors=ERRORS)  # type: ignore[attr-defined]
