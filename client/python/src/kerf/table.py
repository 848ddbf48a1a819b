"""A table that grows row by row and outlives who writes it: a CSV file, a line a row."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from kerf.errors import InvalidArgumentError

#: What a cell is made of.
Value = str | int | float | bool


def cell(value: Value) -> str:
    """The text of a cell, in one line: the end of a line is the end of a row. Floats keep all their bits."""
    return " ".join(str(value).split())


class Table:
    """Rows by their columns. A row counts when its end of line is there."""

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        """Reads a file if there is one, and removes what a killed program has left of a row.

        Raises:
            InvalidArgumentError: Its columns are others; the file is left as it is.
        """
        self.path = path
        self._columns = list(columns)
        self._rows: list[dict[str, str]] = []
        if path.exists():
            self._read(path.read_bytes())

    def __iter__(self) -> Iterator[dict[str, str]]:
        return iter(self._rows)

    def add(self, row: Mapping[str, Value]) -> None:
        """Adds a row at the end; columns that it does not have stay empty."""
        is_new = not self.path.exists() or self.path.stat().st_size == 0
        texts = {column: cell(row.get(column, "")) for column in self._columns}
        self._rows.append(texts)
        with self.path.open("ab", buffering=0) as file:
            # In one call, so that there is never a part of it for long.
            file.write(self._lines([texts], with_header=is_new))

    def remove(self, rows: Sequence[dict[str, str]]) -> None:
        """Takes rows out of it, all at once."""
        self._rows = [row for row in self._rows if row not in rows]
        beside = self.path.with_name(f"{self.path.name}.new")
        beside.write_bytes(self._lines(self._rows, with_header=True))
        beside.replace(self.path)

    def _read(self, data: bytes) -> None:
        end = data.rfind(b"\n") + 1
        if end == 0 and self._lines([], with_header=True).startswith(data):
            os.truncate(self.path, 0)
            return
        header, *rows = csv.reader(io.StringIO(data[: end or None].decode("utf-8")))
        for column in [name for name in self._columns if name not in header]:
            raise self._refused(column, "the table does not have it")
        for column in [name for name in header if name not in self._columns]:
            raise self._refused(column, "only the table has it")
        for number, row in enumerate(rows, start=2):
            if len(row) != len(header):
                raise self._refused(header[min(len(row), len(header) - 1)], f"line {number} has {len(row)} cells")
        os.truncate(self.path, end)
        self._columns = header
        self._rows = [dict(zip(header, row, strict=True)) for row in rows]

    def _refused(self, column: str, why: str) -> InvalidArgumentError:
        limit = ", ".join(self._columns)
        return InvalidArgumentError(f"{self.path}: column {column!r}: {why}", field=column, limit=limit)

    def _lines(self, rows: Sequence[Mapping[str, str]], *, with_header: bool) -> bytes:
        text = io.StringIO()
        writer = csv.DictWriter(text, self._columns, lineterminator="\n")
        if with_header:
            writer.writeheader()
        writer.writerows(rows)
        return text.getvalue().encode()
