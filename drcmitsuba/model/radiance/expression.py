"""Arithmetic of Radiance's function files, as far as generators and glazings need it.

Numbers, names, + − * / ^, parentheses, a sign before a factor, and functions. As in Radiance, ^ is
right-associative and a sign binds more tightly: -2^2 is 4. Definitions `name=…`, `name:…` and
`name(a,b)=…` are separated by semicolons; comments stand in braces, which may nest. A function sees
its own parameters and what is defined for all, not the parameters of its caller. Nothing is
executed: a tree of tuples is walked, whose depth and number of steps are bounded.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

LONGEST = 10_000
"""Largest number of characters of an expression."""
DEEPEST = 40
"""Largest depth of nested parentheses, functions and definitions."""
MOST_STEPS = 20_000
"""Largest number of operations for one expression, definitions included."""

Tree = tuple[Any, ...]
Values = Any
"""A number, or an array of numbers that are computed together."""

_TOKEN = re.compile(
    r"\s*(?:((?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)|([A-Za-z_$@`][\w.$@`]*)|([-+*/^(),]))"
)

FUNCTIONS: dict[str, tuple[int, Callable[..., Values]]] = {
    "sin": (1, np.sin), "cos": (1, np.cos), "tan": (1, np.tan), "asin": (1, np.arcsin),
    "acos": (1, np.arccos), "atan": (1, np.arctan), "atan2": (2, np.arctan2),
    "sqrt": (1, np.sqrt), "exp": (1, np.exp), "log": (1, np.log), "log10": (1, np.log10),
    "abs": (1, np.abs), "floor": (1, np.floor), "ceil": (1, np.ceil),
    "min": (2, np.minimum), "max": (2, np.maximum), "mod": (2, np.mod),
    "bound": (3, lambda low, x, high: np.where(x < low, low, np.where(x > high, high, x))),
    "if": (3, lambda condition, a, b: np.where(np.asarray(condition) > 0, a, b)),
}  # fmt: skip
"""Functions with their numbers of arguments; `if` takes its first value where the condition is
positive, `mod` has the sign of its second argument, `bound` keeps its second between the others."""


class ExpressionError(ValueError):
    """Fault of an expression, without its place."""


class _Reader:
    """Recursive descent over the tokens of one expression."""

    def __init__(self, text: str) -> None:
        if len(text) > LONGEST:
            raise ExpressionError(f"{len(text)} characters")
        self.tokens: list[tuple[str, str]] = []
        at, text = 0, text.rstrip()
        while at < len(text):
            token = _TOKEN.match(text, at)
            if token is None:
                raise ExpressionError(f"{text[at : at + 20]!r} in {text!r}")
            number, name, sign = token.groups()
            kind = "number" if number else "name" if name else "sign"
            self.tokens.append((kind, number or name or sign))
            at = token.end()
        self.at = self.depth = 0

    def next_is(self, *signs: str) -> str:
        """Sign that comes next and is passed, or nothing."""
        if self.at < len(self.tokens) and self.tokens[self.at] in [("sign", s) for s in signs]:
            self.at += 1
            return self.tokens[self.at - 1][1]
        return ""

    def whole(self) -> Tree:
        """Tree of all tokens."""
        tree = self.sum()
        if self.at < len(self.tokens):
            raise ExpressionError(f"{self.tokens[self.at][1]!r} where an operator is due")
        return tree

    def sum(self) -> Tree:
        """Terms with + and −."""
        self.depth += 1
        if self.depth > DEEPEST:
            raise ExpressionError(f"more than {DEEPEST} parentheses deep")
        tree = self.product()
        while sign := self.next_is("+", "-"):
            tree = (sign, tree, self.product())
        self.depth -= 1
        return tree

    def product(self) -> Tree:
        """Powers with * and /."""
        tree = self.power()
        while sign := self.next_is("*", "/"):
            tree = (sign, tree, self.power())
        return tree

    def power(self) -> Tree:
        """Factors with ^, from the right."""
        factors = [self.factor()]
        while self.next_is("^"):
            factors.append(self.factor())
        tree = factors.pop()
        while factors:
            tree = ("^", factors.pop(), tree)
        return tree

    def factor(self) -> Tree:
        """Number, name, function or parentheses, with a sign or without."""
        sign = self.next_is("+", "-")
        if self.next_is("("):
            tree = self.sum()
            self.must(")")
        elif self.at >= len(self.tokens) or self.tokens[self.at][0] == "sign":
            raise ExpressionError("an operand is missing")
        else:
            kind, word = self.tokens[self.at]
            self.at += 1
            tree = (kind, float(word) if kind == "number" else word)
            if kind == "name" and self.next_is("("):
                arguments = [self.sum()]
                while self.next_is(","):
                    arguments.append(self.sum())
                self.must(")")
                tree = ("call", word, tuple(arguments))
        return ("-", ("number", 0.0), tree) if sign == "-" else tree

    def must(self, sign: str) -> None:
        """Pass a sign that has to come."""
        if not self.next_is(sign):
            raise ExpressionError(f"{sign!r} is missing")


Definitions = dict[str, tuple[tuple[str, ...], Tree]]
"""Names of parameters and the tree of each name that is defined."""

_DEFINITION = re.compile(r"\s*([A-Za-z_]\w*)\s*(?:\(([^()]*)\))?\s*[=:](.*)", re.DOTALL)


def definitions(text: str) -> Definitions:
    """Definitions that are separated by semicolons.

    Raises
    ------
    ExpressionError
        One of them cannot be read.
    """
    known: Definitions = {}
    for part in without_comments(text).split(";"):
        if not part.strip():
            continue
        definition = _DEFINITION.fullmatch(part)
        if definition is None:
            raise ExpressionError(f"{part.strip()!r} is no definition")
        name, parameters, right = definition.groups()
        names = tuple(p.strip() for p in parameters.split(",")) if parameters else ()
        known[name] = names, _Reader(right).whole()
    return known


def without_comments(text: str) -> str:
    """Text with a blank in place of each comment in braces.

    Raises
    ------
    ExpressionError
        A brace has no partner.
    """
    kept, depth, start = list[str](), 0, 0
    for brace in re.finditer(r"[{}]", text):
        if depth == 0:
            kept.append(text[start : brace.start()])
        depth += 1 if brace.group() == "{" else -1
        if depth < 0:
            break
        start = brace.end()
    if depth:
        raise ExpressionError("a brace of a comment has no partner")
    return " ".join([*kept, text[start:]])


def parse(text: str) -> Tree:
    """Tree of an expression; a fault raises ExpressionError."""
    return _Reader(text).whole()


def value(text: str, variables: Mapping[str, Values], known: Definitions | None = None) -> Values:
    """Value of an expression.

    Parameters
    ----------
    text : str
        Expression.
    variables : mapping of str to float or np.ndarray
        Values of names; arrays share a shape.
    known : Definitions, optional
        Names and functions that are defined by expressions.

    Returns
    -------
    float or np.ndarray
        NaN or infinite where the expression has no value.

    Raises
    ------
    ExpressionError
        The expression cannot be read, names something unknown, or takes too many steps.
    """
    constants: dict[str, Values] = {"PI": np.pi}
    names = constants | dict(variables)
    with np.errstate(all="ignore"):
        return _Walk(known or {}, names).value(parse(text), names, 0)


class _Walk:
    """Evaluation of trees with definitions, of bounded depth and number of steps."""

    def __init__(self, known: Definitions, given: Mapping[str, Values]) -> None:
        self.known, self.given, self.steps = known, given, 0

    def value(self, tree: Tree, names: Mapping[str, Values], depth: int) -> Values:
        """Value of a tree under values of names."""
        self.steps += 1
        if depth > 8 * DEEPEST or self.steps > MOST_STEPS:
            raise ExpressionError("too many steps: do its definitions call themselves?")
        kind = tree[0]
        if kind == "number":
            return np.float64(tree[1])
        if kind == "name":
            if tree[1] in names:
                return names[tree[1]]
            return self.call(tree[1], (), depth)
        if kind == "call":
            arguments = tuple(self.value(t, names, depth + 1) for t in tree[2])
            return self.call(tree[1], arguments, depth)
        a, b = (self.value(t, names, depth + 1) for t in tree[1:])
        if kind == "+":
            return a + b
        if kind == "-":
            return a - b
        if kind == "*":
            return a * b
        return a / b if kind == "/" else np.power(a, b)

    def call(self, name: str, arguments: tuple[Values, ...], depth: int) -> Values:
        """Value of a function, or of a name that a definition gives."""
        if name in self.known:
            parameters, tree = self.known[name]
            if len(parameters) == len(arguments):
                inner = {**self.given, **dict(zip(parameters, arguments, strict=True))}
                return self.value(tree, inner, depth + 1)
        elif name in FUNCTIONS and FUNCTIONS[name][0] == len(arguments):
            return FUNCTIONS[name][1](*arguments)
        elif name == "arg" and len(arguments) == 1 and np.ndim(arguments[0]) == 0:
            if (key := f"A{int(np.nan_to_num(arguments[0])):d}") in self.given:
                return self.given[key]
        elif name not in FUNCTIONS:
            what = "function" if arguments else "name"
            raise ExpressionError(f"the unknown {what} {name!r}")
        raise ExpressionError(f"{name!r} with {len(arguments)} arguments")
