"""The hash of a surface, as `kerf/v1/view.proto` defines it, over arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

U32 = NDArray[np.uint32]
U64 = NDArray[np.uint64]

_MASK = (1 << 64) - 1


def sum_of_vertices(ids: U32, elements: U32, local: NDArray[np.float32]) -> int:
    """Sum of the hashes of vertices; `local` are u, v, w in their elements, (n, 3)."""
    bits = np.ascontiguousarray(local, dtype=np.float32).view(np.uint32)
    return _sum(0, ids, np.column_stack([elements, bits]))


def sum_of_quads(ids: U32, corners: U32) -> int:
    """Sum of the hashes of quads, (n, 4)."""
    return _sum(1, ids, corners)


def of_surface(sums: list[int]) -> int:
    """Of the sums over each object's vertices and quads, in order."""
    value = np.zeros(1, dtype=np.uint64)
    for each in sums:
        value = _mix(value ^ np.uint64(each))
    return int(value[0])


def exchange(total: int, before: int, after: int) -> int:
    """A sum in which some hashes stand for others now."""
    return (total - before + after) & _MASK


def _sum(kind: int, ids: U32, values: U32) -> int:
    a, b, c, d = values.astype(np.uint64).T
    shift = np.uint64(32)
    value = _mix(ids.astype(np.uint64) << shift | a)
    value = _mix(value ^ (b << shift | c))
    value = _mix(value ^ (np.uint64(kind << 32) | d))
    return int(value.sum(dtype=np.uint64))


def _mix(x: U64) -> U64:
    x = x + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))
