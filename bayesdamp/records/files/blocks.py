"""Several small tables side by side in one, as spreadsheets have them: `Time, Angle, , Time, Angle`."""

from __future__ import annotations

from collections.abc import Sequence


def side_by_side(names: Sequence[str], above: Sequence[str] = ()) -> tuple[str, ...]:
    """For each column the table that it belongs to, empty where all of them are one table.

    names: those of the columns, of which the first of a table is that of its times; tables have the same names, and
    blank columns may stand between them. above: the cells of the line above the names, of which the first in a table is
    what it is called; where there is none, `part 1` and so on.
    """
    first = next((name for name in names if name), "")
    starts = [i for i, name in enumerate(names) if name == first]
    if len(starts) < 2:
        return ()
    ends = [*starts[1:], len(names)]
    blocks = [[name for name in names[a:b] if name] for a, b in zip(starts, ends, strict=True)]
    if (
        len(blocks[0]) < 2
        or any(block != blocks[0] for block in blocks)
        or len(set(blocks[0])) < len(blocks[0])
    ):
        return ()
    labels = [next((cell for cell in above[a:b] if cell), "") for a, b in zip(starts, ends, strict=True)]
    if len({label for label in labels if label}) < len(labels):
        labels = [f"part {i}" for i in range(1, len(labels) + 1)]
    groups = [""] * starts[0]
    for label, a, b in zip(labels, starts, ends, strict=True):
        groups += [label] * (b - a)
    return tuple(groups)
