"""Text of a scene file: its words, statements and commands, with the lines they stand on."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from drcmitsuba.model import source_file
from drcmitsuba.runtime.errors import InputError

MOST_NUMBERS = 30_000
"""Largest number of arguments of a primitive: a polygon of 10,000 corners."""
LONGEST_LINE = 100_000
"""Largest number of characters of a command."""

_WORD = re.compile(rb"\"[^\"]{0,4096}\"|'[^']{0,4096}'|\S+")
_COMMAND = re.compile(rb"!((?:\\\r?\n|[^\r\n]){0,%d})(?=[\r\n]|\Z)" % LONGEST_LINE)
_COMMENT = re.compile(rb"#[^\r\n]*")
_NO_TEXT = re.compile(rb"[\x00-\x08\x0e-\x1f\x7f]")


class FileLine(NamedTuple):
    """Line of a file."""

    file: Path
    line: int

    def error(self, field: str, got: str, remedy: str) -> InputError:
        """Error that names the file and the line."""
        return InputError(self.file, f"line {self.line}: {field}", got, remedy)

    def of(self, name: str) -> str:
        """Words for something that stands here, as in "office.rad, line 12: wall.3"."""
        return f"{self.file.name}, line {self.line}: {name}"


class Primitive(NamedTuple):
    """Surface, material or pattern as it is written; an alias has its reference as only string."""

    modifier: str
    kind: str
    name: str
    strings: tuple[str, ...]
    numbers: list[float]
    place: FileLine

    def error(self, got: str, remedy: str) -> InputError:
        """Error that names the file, the line and the primitive."""
        return self.place.error(f"{self.kind} {self.name!r}", got, remedy)


class Command(NamedTuple):
    """Line that begins with an exclamation mark."""

    text: str
    place: FileLine


def read_bytes(path: Path, most: int) -> bytes:
    """Read a plain file of text of at most `most` bytes.

    Raises
    ------
    InputError
        The file is missing, a device, too large, or holds bytes that are no text.
    """
    text = source_file.read_bytes(path, most)
    text = text.removeprefix(b"\xef\xbb\xbf").removesuffix(b"\x1a")
    if strange := _NO_TEXT.search(text):
        line = text.count(b"\n", 0, strange.start()) + 1
        got = f"byte 0x{strange.group()[0]:02x}, so it is no text"
        raise InputError(path, f"line {line}", got, "give a scene description as UTF-8 text")
    return text


def sought(name: str, folders: Sequence[Path]) -> Path | None:
    """First plain file of a name in one of the folders; None where there is none."""
    for folder in folders:
        try:
            if (folder / name).is_file():
                return folder / name
        except (OSError, ValueError):  # too long a name, or a NUL in it
            return None
    return None


def statements(text: bytes, file: Path) -> Iterator[Primitive | Command]:
    """Primitives and commands of a scene description, in turn.

    Raises
    ------
    InputError
        The text breaks off, or a count or a number cannot be read.
    """
    at, line, counted = 0, 1, 0
    while word := _WORD.search(text, at):
        begin = word.start()
        line += text.count(b"\n", counted, begin)
        counted = begin
        first = text[begin : begin + 1]
        if first == b"#":
            at = _COMMENT.match(text, begin).end()  # type: ignore[union-attr]
        elif first == b"!":
            place = FileLine(file, line)
            command = _COMMAND.match(text, begin)
            if command is None:
                raise place.error("command", "an endless line", "write files of commands instead")
            yield Command(decoded(re.sub(rb"\\\r?\n", b" ", command.group(1))), place)
            at = command.end()
        else:
            primitive, at = _primitive(text, begin, FileLine(file, line))
            yield primitive


def decoded(word: bytes) -> str:
    """Text of a word: UTF-8, or else Latin-1."""
    try:
        return word.decode("utf-8")
    except UnicodeDecodeError:
        return word.decode("latin-1")


def _unquoted(word: bytes) -> str:
    if len(word) > 1 and word[:1] in b"\"'" and word[-1:] == word[:1]:
        word = word[1:-1]
    return decoded(word)


def _primitive(text: bytes, begin: int, place: FileLine) -> tuple[Primitive, int]:
    """Primitive that begins at a byte, and the byte behind its last argument."""
    words = _WORD.finditer(text, begin)
    head = list(islice(words, 4))
    if len(head) < 4:
        raise place.error("primitive", "the file ends within it", "write modifier, type and name")
    modifier, kind, name, fourth = (_unquoted(word.group()) for word in head)
    if kind == "alias":
        return Primitive(modifier, kind, name, (fourth,), [], place), head[3].end()

    def arguments(count: bytes, what: str) -> list[re.Match[bytes]]:
        if count == b"0":
            return []
        if not count.isdigit() or len(count) > 9:
            got = f"{decoded(count)!r} as the number of {what}"
            raise place.error(f"{kind} {name!r}", got, "write how many follow")
        if int(count) > MOST_NUMBERS:
            got = f"{int(count)} {what}"
            raise place.error(f"{kind} {name!r}", got, f"give at most {MOST_NUMBERS}")
        taken = list(islice(words, int(count)))
        if len(taken) < int(count):
            got = f"the file ends after {len(taken)} of {int(count)} {what}"
            raise place.error(f"{kind} {name!r}", got, "write the rest")
        return taken

    def count() -> re.Match[bytes]:
        word = next(words, None)
        if word is None:
            got = "the file ends before its counts"
            raise place.error(f"{kind} {name!r}", got, "write three counts")
        return word

    strings = tuple(_unquoted(s.group()) for s in arguments(fourth.encode(), "strings"))
    arguments(count().group(), "integers")
    last = count()
    numbers = arguments(last.group(), "numbers")
    end = numbers[-1].end() if numbers else last.end()
    try:
        values = [float(number.group()) for number in numbers]
    except ValueError:
        values = []
    # Python takes 1_000 for a number.
    if len(values) < len(numbers) or b"_" in text[last.end() : end]:
        wrong = next(w for w in (n.group() for n in numbers) if not is_number(w))
        got = f"{decoded(wrong)!r} among its numbers"
        raise place.error(f"{kind} {name!r}", got, "write numbers, and comments between primitives")
    return Primitive(modifier, kind, name, strings, values, place), end


def is_number(word: bytes | str) -> bool:
    """Whether a word is a number in the notation of C."""
    try:
        float(word)
    except ValueError:
        return False
    return (b"_" if isinstance(word, bytes) else "_") not in word  # type: ignore[operator]
