"""Rows of variables as arrays of numpy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Column = tuple[str, str, list[str], str, str, bytearray]
"""Name, unit, labels, type of the bytes, type of the values, bytes."""
Rows = tuple[str, bytearray, bytearray, bytearray, list[Column]]
"""Name of the source, ticks, times, losses, columns."""


@dataclass(frozen=True)
class Series:
    """Values of a variable, with the rows in which they came. All arrays have the shape (rows,)."""

    name: str
    """The name of the variable."""
    source: str
    """Its processor, and its loop or published cell: `processor:loop`."""
    unit: str
    """The unit of the values; empty without one."""
    labels: list[str]
    """The labels of a choice, whose values are their numbers; otherwise empty."""
    values: npt.NDArray[Any]
    """The values, in the type that the variable has."""
    time_ns: npt.NDArray[np.uint64]
    """The instants on the clock of the system, ns: when the tick was released, or the cell was read."""
    tick: npt.NDArray[np.uint64]
    """The numbers of the ticks; for a cell, the sequence numbers of its values."""
    lost_before: npt.NDArray[np.uint64]
    """The number of rows that were lost between the row before and this one; 0 for a cell, which is sampled."""

    @property
    def time(self) -> npt.NDArray[np.float64]:
        """The instants on the clock of the system, s; shape (rows,)."""
        return self.time_ns.astype(np.int64) / 1e9

    @property
    def lost(self) -> int:
        """The number of rows that were lost between the last row of the read before and the last one here."""
        return int(self.lost_before.sum())

    def __len__(self) -> int:
        return len(self.values)


class Samples(Mapping[str, Series]):
    """What was read of watched variables: a `Series` for each name.

    Variables of one loop share their rows: element i of each belongs to the same tick. Loops have rows of their own.
    """

    def __init__(self, series: list[Series]) -> None:
        self._series = {one.name: one for one in series}

    def __getitem__(self, name: str) -> Series:
        try:
            return self._series[name]
        except KeyError:
            raise KeyError(f"{name!r} was not watched; {', '.join(self._series)} were") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._series)

    def __len__(self) -> int:
        return len(self._series)

    @property
    def lost(self) -> dict[str, int]:
        """The number of lost rows of each loop or cell."""
        return {one.source: one.lost for one in self._series.values()}

    def matrix(self, names: list[str]) -> npt.NDArray[np.float64]:
        """Returns the values of variables of one loop as columns; shape (rows, names)."""
        sources = {self[name].source for name in names}
        if len(sources) != 1:
            raise ValueError(f"a matrix is of variables of one loop, not of {', '.join(sorted(sources))}")
        return np.column_stack([self[name].values.astype(np.float64) for name in names])

    def __repr__(self) -> str:
        of_each = (f"{name}: {len(one)} rows, {one.lost} lost" for name, one in self._series.items())
        return f"Samples({'; '.join(of_each)})"


def of_rows(sources: list[Rows]) -> Samples:
    """Makes arrays of what the native part returns."""
    series = []
    for source, ticks, times, lost, columns in sources:
        tick, time_ns, lost_before = (np.frombuffer(it, "<u8") for it in (ticks, times, lost))
        for name, unit, labels, stored, wanted, words in columns:
            values = np.frombuffer(words, stored).astype(wanted, copy=False)
            series.append(Series(name, source, unit, labels, values, time_ns, tick, lost_before))
    return Samples(series)
