"""A candidate's damping and frequency against amplitude, to be laid over those that are read from the record."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from bayesdamp.inference.curves.derived import Motions
from bayesdamp.outcomes import following
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.candidates.posteriors import amplitude_grid
from bayesdamp.pipeline.records.records import plain_seconds
from bayesdamp.records.oscillation.curves import amplitude_curves
from bayesdamp.store import CellResult
from bayesdamp.store.contents.candidates import ModeContent
from bayesdamp.types import OK, Refusal


def compute_curve(branch: Branch, name: str, key: str) -> None:
    """The fall of the log amplitude over 2π and the frequency (rad/s) of the mode, over the record's amplitudes.

    What is first the motion without its losses, at each amplitude, is set right by what the reading makes of the fitted
    record: of a velocity or an acceleration crossings shift as the damping changes, and a swing has no one amplitude.
    """
    began = time.perf_counter()
    found = branch.store.read(f"mode/{branch.path}")
    if found.outcome != OK:
        branch.store.write(CellResult(name, key, outcome=following(found.name, found.outcome)))
        return
    seen = branch.record.seen
    grid = amplitude_grid(seen)
    mode = ModeContent.of(found)
    values = {**mode.known, **mode.values}

    def undamped(amplitudes: np.ndarray) -> dict[str, np.ndarray]:
        motions = Motions(
            Oscillator(branch.terms, branch.restoring),
            {n: np.full(amplitudes.shape, v) for n, v in values.items()},
            seen.rest,
            seen.amplitude,
        ).at(amplitudes)
        ratio = np.asarray(motions.lost / (amplitudes * motions.slope)) / (2 * np.pi)
        return {"ratio": ratio, "frequency": 2 * np.pi / np.asarray(motions.period)}

    arrays = undamped(grid)
    try:
        read = amplitude_curves(replace(branch.record.signal, y=found.arrays["fit"]), seen)
    except Refusal:
        read = None  # a candidate whose motion has no swings
    if read is not None:
        for what, at_points in undamped(read.amplitude).items():
            off = getattr(read, what) - at_points
            known = np.isfinite(off)
            if np.any(known):
                order = np.argsort(read.amplitude[known])
                arrays[what] = arrays[what] + np.interp(
                    np.log(grid), np.log(read.amplitude[known][order]), off[known][order]
                )
    branch.store.write(CellResult(name, key, {}, {"amplitude": grid, **arrays}, OK, plain_seconds(began)))
