"""Values that each have a column of times of their own beside them: `Time A, A, Time B, B`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bayesdamp.records.columns.names import parted
from bayesdamp.records.files.contents import Column, Contents


def paired(found: Contents, is_clock: Callable[[Column], bool]) -> Contents:
    """Put each column of times into a group with the values behind it, where a table has several that differ.

    The times may stand behind their values too, if they do so throughout. A table whose runs are marked stays as it
    is. is_clock: whether a column can hold the times of others.
    """
    columns = list(found.columns)
    for group in dict.fromkeys(c.group for c in columns):
        at = [i for i, c in enumerate(columns) if c.group == group and np.isfinite(c.values).any()]
        if any(parted(columns[i])[1] for i in at):
            continue
        clocks = [is_clock(columns[i]) for i in at]
        if clocks and clocks[-1]:
            at, clocks = at[::-1], clocks[::-1]
        starts = [k for k, clock in enumerate(clocks) if clock]
        ends = [*starts[1:], len(at)]
        alternate = (
            len(starts) > 1 and starts[0] == 0 and all(b - a > 1 for a, b in zip(starts, ends, strict=True))
        )
        if not alternate or all(
            np.array_equal(columns[at[0]].values, columns[at[k]].values, equal_nan=True) for k in starts
        ):
            continue
        for number, (a, b) in enumerate(zip(starts, ends, strict=True), start=1):
            for i in at[a:b]:
                columns[i] = replace(columns[i], group=f"{group} pair {number}".strip())
        found = replace(found, paired=True)
    return replace(found, columns=tuple(columns))
