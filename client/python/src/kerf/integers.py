"""Integers in `bytes` fields, as `kerf/v1/view.proto` says: zigzag, groups of seven bits, zeros counted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from kerf.errors import ReplicaError


def decode(field: str, data: bytes, most: int) -> NDArray[np.int64]:
    """Reads as many integers as are written, at most `most`.

    Raises:
        ReplicaError: The bytes are no integers, or more of them.
    """
    values = np.zeros(most, dtype=np.int64)
    count = 0
    groups = _groups(field, data)
    for group in groups:
        # A zero is followed by the number of further ones.
        run = 1 if group else 1 + next(groups, most)
        if run > most - count:
            raise ReplicaError(f"{field}: more than {most} integers", field=field, limit=f"{most} integers")
        if group:
            values[count] = (group >> 1) ^ -(group & 1)
        count += run
    return values[:count]


def _groups(field: str, data: bytes) -> Iterator[int]:
    value = shift = 0
    for byte in data:
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            if value >> 64:
                break
            yield value
            value = shift = 0
        elif shift < 63:
            shift += 7
        else:
            # Shifted on, one without an end would take the square of its length in time.
            break
    if shift or value:
        raise ReplicaError(f"{field}: not integers of 64 bits", field=field, limit="integers of 64 bits")
