"""The one error that a user's input raises: a line that says where, what came, and what to do."""

from __future__ import annotations


class InputError(ValueError):
    """Bad input, told in one line.

    Parameters
    ----------
    source : str
        File, or the part of the input, that is wrong.
    field : str
        Key, column, row or argument within it.
    got : str
        What came.
    remedy : str
        What to do about it.
    """

    def __init__(self, source: object, field: str, got: str, remedy: str) -> None:
        self.source, self.field, self.got, self.remedy = str(source), field, got, remedy
        parts = (on_a_line(part) for part in (self.source, field, got, remedy))
        super().__init__("{}: {}: {}; {}".format(*parts))


LONGEST = 300
"""Characters of a part of the line: names and values come from files that somebody else wrote."""


def on_a_line(text: str) -> str:
    """Text in printable characters and single spaces, its middle left out where it is long."""
    text = " ".join(text.split())
    if len(text) > LONGEST:
        text = f"{text[: LONGEST // 2]}…{text[-LONGEST // 2 :]}"
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


class BackendError(RuntimeError):
    """No fit compiler backend (LLVM or CUDA) for Dr.Jit on this machine."""


def was_stopped(error: BaseException | None) -> bool:
    """Whether Ctrl-C is behind an error: within a loop Dr.Jit makes a RuntimeError of it."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None
