"""The text of a tensor tree: numbers in nested braces, read and written without recursion."""

from __future__ import annotations

import numpy as np
from drcmitsuba_plugins.tensor import MAX_DEPTH, TensorTree, morton

_CHARACTERS = frozenset(b"0123456789+-.eE,{} \t\r\n")
_OPEN, _CLOSE = b"{}"


def read(text: str, rank: int) -> TensorTree:
    """Read a tree: node = '{' 2ʳ nodes '}' or '{' a grid of (2ᵏ)ʳ numbers '}', r the rank.

    Child n has bit i of n set where coordinate i ≥ ½; in a grid the last coordinate runs fastest.

    Raises
    ------
    ValueError
        Braces, counts or characters are wrong.
    """
    raw = text.encode("ascii", "replace")
    alien = set(raw) - _CHARACTERS
    if alien:
        start = min(raw.index(bytes([c])) for c in alien)
        words = text[start : start + 40].split()
        raise ValueError(f"{(words or ['?'])[0][:20]!r} among the numbers")
    data = np.frombuffer(raw, np.uint8)
    at = np.flatnonzero((data == _OPEN) | (data == _CLOSE))
    opens = data[at] == _OPEN
    depth = np.cumsum(np.where(opens, 1, -1))
    if len(at) < 2 or depth[-1] != 0 or depth.min() < 0 or (depth[:-1] == 0).any():
        raise ValueError("braces that do not match")
    try:
        numbers = np.array(raw.translate(bytes.maketrans(b"{},", b"   ")).split(), float)
    except ValueError:
        raise ValueError("something that is no number among the numbers") from None
    blank = np.isin(data, np.frombuffer(b" \t\r\n,{}", np.uint8))
    starts = np.cumsum(~blank & np.concatenate([[True], blank[:-1]]))
    before = starts[at]  # count of numbers that begin before each brace
    is_leaf = opens & np.append(~opens[1:], False)
    inside = np.diff(np.append(before, before[-1]))
    if before[0] != 0 or (inside[~is_leaf] != 0).any() or len(numbers) != before[-1]:
        raise ValueError("numbers outside the innermost braces")
    return _assemble(rank, numbers, *_paths(rank, opens, depth, is_leaf), before, inside)


def _paths(
    rank: int, opens: np.ndarray, depth: np.ndarray, is_leaf: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Index of the brace, Morton code and level of every block of numbers, shape (block,) each."""
    blocks, codes, levels = [], [], []
    level, node, code = 0, np.zeros(1, np.int64), np.zeros(1, np.int64)
    while True:
        leaf = is_leaf[node]
        blocks.append(node[leaf])
        codes.append(code[leaf])
        levels.append(np.full(leaf.sum(), level))
        if leaf.all():
            break
        level += 1
        if level > MAX_DEPTH:
            raise ValueError(f"more than {MAX_DEPTH} levels")
        children = np.flatnonzero(opens & (depth == level + 1))
        parent = np.searchsorted(node, children) - 1
        count = np.bincount(parent, minlength=len(node))
        wrong = count != np.where(leaf, 0, 1 << rank)
        if wrong.any():
            raise ValueError(f"{count[wrong][0]} branches where {1 << rank} belong")
        first = np.cumsum(count) - count
        code = (code[parent] << rank) + np.arange(len(children)) - first[parent]
        node = children
    return np.concatenate(blocks), np.concatenate(codes), np.concatenate(levels)


def _assemble(
    rank: int, numbers: np.ndarray, block: np.ndarray, code: np.ndarray, level: np.ndarray,
    before: np.ndarray, inside: np.ndarray,
) -> TensorTree:  # fmt: skip
    """Tree of the numbers of all blocks, in Morton order at the depth of the finest block."""
    count = inside[block]
    sizes = {1 << rank * k: k for k in range(MAX_DEPTH + 1)}
    if not set(np.unique(count).tolist()) <= set(sizes):
        wrong = next(c for c in count.tolist() if c not in sizes)
        raise ValueError(f"a block of {wrong} numbers, which is no power of {1 << rank}")
    inner = np.array([sizes[c] for c in count.tolist()])
    total = int((level + inner).max())
    if total > MAX_DEPTH:
        raise ValueError(f"more than {MAX_DEPTH} levels")
    start, levels, values = [], [], []
    for k in np.unique(inner):
        mine = inner == k
        n = 1 << k
        grid = np.indices((n,) * rank).reshape(rank, -1)
        within = morton([g / n for g in grid], int(k))
        whole = (code[mine, None] << rank * k) + within
        start.append((whole << (rank * (total - level[mine] - k))[:, None]).ravel())
        levels.append(np.repeat(level[mine] + k, n**rank))
        values.append(numbers[before[block[mine], None] + np.arange(n**rank)].ravel())
    order = np.argsort(np.concatenate(start), kind="stable")
    joined = (np.concatenate(x)[order] for x in (start, levels, values))
    return TensorTree(rank, total, *joined)


def write(tree: TensorTree, digits: int = 5) -> str:
    """Text of a tree in nested braces, one line per leaf."""
    shown = [f"{v:.{digits}g}" for v in tree.value]
    first = tree.start
    lines = []
    # A leaf opens a brace for each level from which on its code has only zeros.
    for i, (code, level) in enumerate(zip(first.tolist(), tree.level.tolist(), strict=True)):
        tail = tree.rank * tree.depth
        opened = next(
            k for k in range(level + 1) if code & ((1 << (tail - tree.rank * k)) - 1) == 0
        )
        end = code + (1 << (tail - tree.rank * level))
        closed = next(k for k in range(level + 1) if end & ((1 << (tail - tree.rank * k)) - 1) == 0)
        lines.append("{" * (level - opened + 1) + shown[i] + "}" * (level - closed + 1))
    return "\n".join(lines)
