"""Commands in scene files, read without a shell: words, quotes and pipes, and nothing else."""

from __future__ import annotations

import re

from drcmitsuba.model.radiance.text import Command

_PIECE = r"""[^\s|;&<>()`$"'\\]|"[^"\\`$]*"|'[^']*'|\\."""
_TOKEN = re.compile(rf"\s*(?:((?:{_PIECE})+)|(\S))", re.DOTALL)
_QUOTED = re.compile(r"""\"([^"]*)\"|'([^']*)'|\\(.)""", re.DOTALL)
KNOWN = ("xform", "genbox", "gensurf", "genprism", "genrev", "genworm", "genblinds", "cat")
"""Names of the commands that are understood."""


def pipeline(command: Command) -> list[list[str]]:
    """Words of each command of a pipe.

    Raises
    ------
    InputError
        The line asks for more than words and pipes, or for a command that is not known.
    """
    stages: list[list[str]] = [[]]
    text = command.text.strip()
    at = 0
    while at < len(text):
        token = _TOKEN.match(text, at)
        assert token is not None
        word, sign = token.groups()
        if sign == "|":
            stages.append([])
        elif sign:
            remedy = "write words, quotes and pipes: no shell reads them"
            raise command.place.error("command", f"{sign!r} in {text!r}", remedy)
        else:
            stages[-1].append(_QUOTED.sub(lambda quoted: "".join(quoted.groups("")), word))
        at = token.end()
    for i, words in enumerate(stages):
        name = words[0] if words else ""
        if name not in KNOWN or (i > 0 and name not in ("xform", "cat")):
            got = f"{name!r} in {text!r}"
            remedy = f"only {', '.join(KNOWN)} are understood: run it and give the file it writes"
            raise command.place.error("command", got, remedy)
    return stages
