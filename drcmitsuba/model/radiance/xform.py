"""Transforms of Radiance's `xform`: turns, shifts, uniform scales, mirrors, and arrays of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drcmitsuba.model.radiance.text import FileLine, is_number

MOST_COPIES = 1_000_000
"""Largest number of copies of an array."""
LARGEST = 1e12
"""Largest magnitude of a number in a transform."""
ARGUMENTS = {"-t": 3, "-s": 1, "-rx": 1, "-ry": 1, "-rz": 1, "-mx": 0, "-my": 0, "-mz": 0}
"""Number of arguments of each option."""


@dataclass(frozen=True)
class Moves:
    """Similarities of space, one for each copy."""

    matrix: np.ndarray
    """Homogeneous matrices, shape (copy, 4, 4)."""

    def __len__(self) -> int:
        return len(self.matrix)

    @property
    def scale(self) -> np.ndarray:
        """Ratio of lengths, > 0, shape (copy,)."""
        return np.asarray(np.linalg.norm(self.matrix[:, :3, 0], axis=1))

    @property
    def mirrored(self) -> np.ndarray:
        """Whether left becomes right, bool, shape (copy,)."""
        x, y, z = np.moveaxis(self.matrix[:, :3, :3], 2, 0)
        return np.einsum("kx,kx->k", np.cross(x, y), z) < 0

    def one(self, copy: int) -> Moves:
        """One copy's move."""
        return Moves(self.matrix[[copy]])

    def then(self, later: Moves) -> Moves:
        """Each of these moves followed by each of the later ones, which run faster."""
        return Moves(np.einsum("lij,kjm->klim", later.matrix, self.matrix).reshape(-1, 4, 4))

    def of(self, quads: np.ndarray) -> np.ndarray:
        """Copies (copy, quad, 4, 3) of quads (quad, 4, 3); mirrored ones keep their front."""
        turn, shift = self.matrix[:, :3, :3], self.matrix[:, :3, 3]
        with np.errstate(all="ignore"):  # what overflows is refused behind
            copies = np.einsum("kij,qcj->kqci", turn, quads) + shift[:, None, None]
            mirrored = self.mirrored
        copies[mirrored] = reversed_front(copies[mirrored])
        return copies

    def direction(self, vector: np.ndarray) -> np.ndarray:
        """Direction (3,) after the first copy's move, of any length."""
        return np.asarray(self.matrix[0, :3, :3] @ vector)


STILL = Moves(np.eye(4)[None])


def reversed_front(quads: np.ndarray) -> np.ndarray:
    """Quads (…, 4, 3) with their fronts turned round; triangles still repeat their last corner."""
    triangle = (quads[..., 2, :] == quads[..., 3, :]).all(axis=-1)[..., None, None]
    return np.where(triangle, quads[..., [2, 1, 0, 0], :], quads[..., ::-1, :])


def _step(option: str, values: Sequence[float]) -> np.ndarray:
    """Matrix (4, 4) of one option."""
    matrix = np.eye(4)
    if option == "-t":
        matrix[:3, 3] = values
    elif option == "-s":
        matrix[:3, :3] *= values[0]
    elif option[1] == "m":
        i = "xyz".index(option[2])
        matrix[i, i] = -1
    else:
        i = "xyz".index(option[2])
        j, k = (i + 1) % 3, (i + 2) % 3
        c, s = np.cos(np.radians(values[0])), np.sin(np.radians(values[0]))
        matrix[[j, j, k, k], [j, k, j, k]] = c, -s, s, c
    return matrix


def _values(option: str, given: Sequence[str], place: FileLine) -> list[float]:
    """Arguments of an option as numbers."""
    values = [float(word) for word in given if is_number(word)]
    wrong = len(values) < ARGUMENTS[option] or not all(abs(v) <= LARGEST for v in values)
    if wrong or (option == "-s" and values == [0]):
        got = " ".join((option, *given))
        remedy = f"give {ARGUMENTS[option]} numbers of at most {LARGEST:.0e}, and no scale of 0"
        raise place.error("xform", got, remedy)
    return values


def _count(option: str, words: Sequence[str], place: FileLine) -> int:
    """Argument of -a or -i, which is the first of the words."""
    word = words[0] if words else ""
    least = int(option == "-a")
    if not (word.isascii() and word.isdigit() and least <= int(word[:9]) <= MOST_COPIES):
        got = f"{option} {word}"
        raise place.error("xform", got, f"give a count of {least} to {MOST_COPIES}")
    return int(word[:9])


def _repeated(step: np.ndarray, option: str, count: int) -> Moves:
    """One move that is the step `count` times, or copies with 0 to count − 1 of them."""
    if option == "-i":
        return Moves(np.linalg.matrix_power(step, count)[None])
    powers = [np.eye(4)]
    for _ in range(count - 1):
        powers.append(step @ powers[-1])
    return Moves(np.array(powers))


def transform(words: Sequence[str], place: FileLine) -> tuple[Moves, int]:
    """Moves that options say, and the number of words that are options.

    Parameters
    ----------
    words : sequence of str
        Options with their arguments; the first word that is none ends them.
    place : Place
        Line on which they stand, for errors.

    Raises
    ------
    InputError
        A count or a number is missing or unfit, or there are more than 1,000,000 copies.
    """
    moves, step, kind, count, at = STILL, np.eye(4), "-i", 1, 0
    with np.errstate(all="ignore"):  # what overflows is refused where it moves a surface
        while at < len(words) and words[at] in (*ARGUMENTS, "-a", "-i"):
            option = words[at]
            if option in ARGUMENTS:
                given = words[at + 1 : at + 1 + ARGUMENTS[option]]
                step = _step(option, _values(option, given, place)) @ step
                at += 1 + ARGUMENTS[option]
                continue
            moves = moves.then(_repeated(step, kind, count))
            step, kind, count = np.eye(4), option, _count(option, words[at + 1 :], place)
            if len(moves) * (count if kind == "-a" else 1) > MOST_COPIES:
                got = f"{len(moves) * count} copies"
                raise place.error("xform", got, f"make at most {MOST_COPIES}")
            at += 2
        return moves.then(_repeated(step, kind, count)), at
