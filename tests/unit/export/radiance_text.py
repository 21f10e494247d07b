"""A reader of Radiance's text that knows nothing of the writer: primitives by their words."""

import re
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Primitive:
    modifier: str
    kind: str
    name: str
    words: list
    numbers: list


def primitives(text):
    """Primitives of a scene; commands (`!`) and unknown words fail."""
    words = iter(text.split())
    made = []
    for modifier in words:
        assert modifier[0] not in "!#"
        kind, name = next(words), next(words)
        strings = [next(words) for _ in range(int(next(words)))]
        assert next(words) == "0"
        numbers = [float(next(words)) for _ in range(int(next(words)))]
        made.append(Primitive(modifier, kind, name, strings, numbers))
    return made


def matrix(path):
    """Header and entries (row, column, 3) of a binary matrix."""
    head, body = path.read_bytes().split(b"\n\n", 1)
    first, *lines = head.decode("ascii").splitlines()
    assert first == "#?RADIANCE"
    header = dict(re.fullmatch(r"(?:(\w+)=)?(.*)", line).groups() for line in lines)
    assert header["FORMAT"].strip() == "float"
    assert header["BigEndian"] == "0"
    shape = [int(header[name]) for name in ("NROWS", "NCOLS", "NCOMP")]
    return np.frombuffer(body, "<f4").reshape(shape)
