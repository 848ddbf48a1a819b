"""The hash of a surface, as `kerf/v1/view.proto` defines it, over arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
U32 = NDArray[np.uint32]
U64 = NDArray[np.uint64]

_MASK = (1 << 64) - 1


#: In the place where a vertex has its material, which is below both.
_QUAD, _HELD = 1 << 16, 1 << 17


def sum_of_vertices(ids: U32, elements: U32, local: F32, materials: U32) -> int:
    """Sum of the hashes of vertices; `local` are u, v, w in their elements, (n, 3)."""
    u, v, w = _bits(local).T
    return _sum(ids, elements, u, v, materials, w)


def sum_of_held(ids: U32, weights: F32) -> int:
    """Sum of the hashes of the weights of vertices beside what is held, (n, 8)."""
    *first, last = _bits(weights).T
    return _sum(ids, *first, np.full_like(last, _HELD), last)


def sum_of_quads(ids: U32, corners: U32) -> int:
    """Sum of the hashes of quads, (n, 4)."""
    a, b, c, d = corners.T
    return _sum(ids, a, b, c, np.full_like(d, _QUAD), d)


def of_surface(sums: list[int]) -> int:
    """Of the sums over each object's items, in order."""
    value = np.zeros(1, dtype=np.uint64)
    for each in sums:
        value = _mix(value ^ np.uint64(each))
    return int(value[0])


def exchange(total: int, before: int, after: int) -> int:
    """A sum in which some hashes stand for others now."""
    return (total - before + after) & _MASK


def _bits(values: F32) -> U32:
    return np.ascontiguousarray(values, dtype=np.float32).view(np.uint32)


def _sum(*halves: U32) -> int:
    """Sum of the hashes of items that are told by the halves of their words, the upper one first."""
    value = np.zeros(len(halves[0]), dtype=np.uint64)
    for upper, lower in zip(halves[::2], halves[1::2], strict=True):
        value = _mix(value ^ (upper.astype(np.uint64) << np.uint64(32) | lower))
    return int(value.sum(dtype=np.uint64))


def _mix(x: U64) -> U64:
    x = x + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))
