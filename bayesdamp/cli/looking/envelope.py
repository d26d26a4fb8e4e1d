"""What `bayesdamp look` says of an envelope: its readings, and where the decay in it is."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bayesdamp.envelope.records.reading import read_envelope
from bayesdamp.envelope.records.window import bounded
from bayesdamp.types import Refusal


@dataclass(frozen=True)
class Looked:
    """The readings as they were recorded, over time in s, both (n,); the decay's ends in s, None where there is none;
    what is to be said."""

    title: str
    lines: tuple[str, ...]
    t: np.ndarray
    y: np.ndarray
    kept: tuple[float, float] | None


def looked_at(
    path: Path,
    time: str | None,
    value: str | None,
    rate: float | None,
    unit: str | None,
    start: float | str,
    stop: float | str,
) -> Looked:
    """An envelope, and the free decay in it. Raises InputError where it cannot be read."""
    record = read_envelope(path, time=time, value=value, rate=rate, unit=unit)
    t, level = record.t, record.level
    y = level if record.logarithmic else np.array([record.amplitude(float(one))[0] for one in level])
    first, last = (one if isinstance(one, float) else None for one in (start, stop))
    try:
        window = bounded(t, level, first, last)
    except Refusal as refusal:
        return Looked(_title(record.unit, t), (*record.notes, f"No free decay: {refusal}."), t, y, None)
    kept = float(t[window.start]), float(t[window.stop - 1])
    lines = [f"The decay {' and '.join(why for why in window.why if why)}."]
    lines.append(f"It falls by {level[window.start] - level[window.stop - 1]:.3g} dB.")
    if record.frequency is not None:
        lines.append(f"The oscillation's frequency is {record.frequency:.9g} Hz.")
    else:
        lines.append(f"For Q: bayesdamp compare {shlex.quote(str(path))} --frequency HZ")
    return Looked(_title(record.unit, t), (*record.notes, *lines), t, y, kept)


def _title(unit: str, t: np.ndarray) -> str:
    return f"an envelope in {unit}: {t.size} readings from {t[0]:.4g} to {t[-1]:.4g} s"
