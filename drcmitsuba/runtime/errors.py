"""Errors for users: one line that names the place, the value and the remedy."""

from __future__ import annotations

from pathlib import Path


class InputError(ValueError):
    """Bad input, described in one line.

    Parameters
    ----------
    source : str or Path
        File or part of the input with the mistake; a path in the current folder is told from there.
    field : str
        Key, column, row or argument in the source.
    got : str
        Value or state that the program met.
    remedy : str
        Advice to the user.

    Examples
    --------
    >>> import drcmitsuba
    >>> drcmitsuba.load_case("a.toml")
    Traceback (most recent call last):
    drcmitsuba.runtime.errors.InputError: a.toml: case file: no such file; give a case or a building
    """

    def __init__(self, source: object, field: str, got: str, remedy: str) -> None:
        self.source, self.field, self.got, self.remedy = _named(source), field, got, remedy
        parts = (on_a_line(part) for part in (self.source, field, got, remedy))
        super().__init__("{}: {}: {}; {}".format(*parts))

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, str, str]]:
        """Let other processes raise it here."""
        return InputError, (self.source, self.field, self.got, self.remedy)


def _named(source: object) -> str:
    """Name of a source; that of a file in the current folder is short."""
    if isinstance(source, Path) and source.is_absolute() and Path.cwd() in source.parents:
        return str(source.relative_to(Path.cwd()))
    return str(source)


LONGEST = 300
"""Largest number of characters of a part of the line: names and values may come from any file."""


def on_a_line(text: str) -> str:
    """Text in printable characters and single spaces, without its middle where it is long."""
    text = " ".join(text.split())
    if len(text) > LONGEST:
        text = f"{text[: LONGEST // 2]}…{text[-LONGEST // 2 :]}"
    return printable(text)


def printable(text: str) -> str:
    """Text whose control characters are written out: a terminal would obey them."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


class BackendError(RuntimeError):
    """No fit compiler backend (LLVM or CUDA) for Dr.Jit on this machine."""


def was_stopped(error: BaseException | None) -> bool:
    """Whether Ctrl-C caused an error: Dr.Jit's loops turn KeyboardInterrupt into RuntimeError."""
    return is_caused_by(error, KeyboardInterrupt)


def is_caused_by(error: BaseException | None, kind: type[BaseException]) -> bool:
    """Whether an error is of a kind, or came while one of this kind was handled."""
    while error is not None and not isinstance(error, kind):
        error = error.__cause__ or error.__context__
    return error is not None
