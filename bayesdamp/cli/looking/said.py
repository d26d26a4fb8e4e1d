"""What `bayesdamp look` says of a file and of the records in it: on the terminal and on its page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from bayesdamp.cli.asking import Found
    from bayesdamp.records.files.contents import Contents
    from bayesdamp.table import Table


MANY = 4
"""Holes that are named one by one."""


def described(held: Contents) -> Table:
    """A row for each column: number, name, unit, samples, first and largest values."""
    import numpy as np

    from bayesdamp.records.files.names import seconds_of_unit, unit_said
    from bayesdamp.table import Table
    from bayesdamp.units import UNITS

    rows = []
    for i, column in enumerate(held.columns, start=1):
        unit, quantity = unit_said(column)
        said = UNITS[unit].of(quantity or "angle") if unit in UNITS else unit
        said = "s" if not said and seconds_of_unit(column) else said
        y = column.values[np.isfinite(column.values)]
        ends = (f"{y.min():.6g}", f"{y.max():.6g}") if y.size else ("", "")
        rows.append((str(i), column.name or "-", said or "-", str(y.size), *ends))
    return Table(["", "column", "unit", "samples", "from", "to"], rows, (1, 2))


@dataclass(frozen=True)
class Shown:
    """What is shown of a record: its name, what it is read as, what was done to it, what looks wrong; values y in the
    file's unit over times t in s, (n,), and from when to when the free decay lasts, None where there is none."""

    name: str
    reading: str
    lines: Sequence[str]
    doubts: Sequence[str]
    t: np.ndarray
    y: np.ndarray
    kept: tuple[float, float] | None


def shown_motion(one: Found, several: bool) -> Shown:
    """Return what is shown of an oscillation. several: whether its file has others, so that its label says which."""
    import numpy as np

    raw = one.raw
    t = raw.t if raw.t is not None else np.arange(raw.y.size) / (raw.rate or 1.0)
    about = None if one.signal is None else one.signal.provenance
    kept = None if about is None or about.stop is None else (about.start, about.stop)
    name = (several and one.label) or raw.channel or "the record"
    return Shown(name, _reading(one), _sentences(one), list(map(str, one.findings)), t, raw.y, kept)


def _reading(one: Found) -> str:
    """What a record is read as, in a line."""
    from bayesdamp.units import UNITS

    unit = UNITS[one.unit].of(one.quantity) if one.unit in UNITS else one.unit
    time, value = one.raw.columns
    clock = f"times from column {time!r}" if time is not None else f"{one.raw.rate or 0:.6g} Hz"
    what = UNITS[one.unit].called(one.quantity) if one.unit in UNITS else one.quantity
    return f"column {value!r} as {what} in {unit}, {clock}, {one.raw.y.size} samples"


def _sentences(one: Found) -> list[str]:
    """What was done to a record, or why there is no free decay in it; nothing that its findings say."""
    from bayesdamp.cli.asking import MAYBE_ENVELOPE

    about = one.raw.provenance if one.signal is None else one.signal.provenance
    # `reading` says where times and values are, but not why these.
    notes = (*filter(None, [one.raw.choice]), *(text for text in about.notes if text not in one.raw.why))
    about = replace(about, notes=notes)
    if one.signal is None:
        alone = [MAYBE_ENVELOPE] if one.raw.y.min() >= 0 else []
        return [*about.said, f"No free decay: {one.refusal}", *alone]
    return [*about.said, *_holes(one)]


def _holes(one: Found) -> list[str]:
    """Where the free decay has no samples, which its rate does not say."""
    from bayesdamp.records.oscillation.features import holes
    from bayesdamp.records.oscillation.spectrum import coarse_period

    if one.signal is None:
        return []
    t, begin = one.signal.t, one.signal.provenance.start
    found = holes(t, coarse_period(t, one.signal.y)[0])
    each = [f"{b - a:.3g} s from {begin + a:.4g} s on" for a, b in found[:MANY]]
    more = f" and {len(found) - MANY} more" if len(found) > MANY else ""
    return [f"No samples for {', '.join(each)}{more}: it is fitted across."] if each else []
