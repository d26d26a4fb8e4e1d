"""What `bayesdamp look` shows of an envelope: its readings, and where the decay in it is."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np

from bayesdamp.cli.looking.said import Shown
from bayesdamp.records.envelope.reading import read_envelope
from bayesdamp.records.envelope.window import bounded
from bayesdamp.types import Refusal


def shown_envelope(
    path: Path,
    columns: tuple[str | None, str | None, float | None, str | None],
    ends: tuple[float | str, float | str],
) -> Shown:
    """Return what is shown of an envelope.

    Parameters
    ----------
    path
        Of its file.
    columns
        Of times and of readings, the rate in Hz, and the unit, where they are given.
    ends
        Of the decay in s, or "auto".

    Raises
    ------
    InputError
        Where it cannot be read.
    """
    time, value, rate, unit = columns
    record = read_envelope(path, time=time, value=value, rate=rate, unit=unit)
    t, level = record.t, record.level
    kept = None
    try:
        window = bounded(t, level, *(end if isinstance(end, float) else None for end in ends))
    except Refusal as refusal:
        lines = [f"No free decay: {refusal}."]
    else:
        kept = float(t[window.start]), float(t[window.stop - 1])
        lines = [
            f"The decay {' and '.join(why for why in window.why if why)}.",
            f"It falls by {level[window.start] - level[window.stop - 1]:.3g} dB.",
            f"The oscillation's frequency is {record.frequency:.9g} Hz."
            if record.frequency is not None
            else f"For Q: bayesdamp compare {shlex.quote(str(path))} --frequency HZ",
        ]
    y = level if record.logarithmic else np.array([record.amplitude(float(one))[0] for one in level])
    what = f"{t.size} readings from {t[0]:.4g} to {t[-1]:.4g} s"
    return Shown(f"an envelope in {record.unit}", what, [*record.notes, *lines], (), t, y, kept)
