"""A candidate's damping and frequency against amplitude, to be laid over those that are read from the record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayesdamp.inference.curves.derived import Motions
from bayesdamp.outcomes import following
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.candidates.posteriors import amplitude_grid
from bayesdamp.pipeline.tasks import Product
from bayesdamp.records.oscillation.law_free import amplitude_curves
from bayesdamp.store.contents.candidates import ModeContent
from bayesdamp.types import OK, Refusal


def compute_curve(branch: Branch) -> Product:
    """Compute the damping ratio and the frequency (rad/s) of the mode over the record's amplitudes.

    They begin as those of the undamped motion at each amplitude, and are corrected by what `amplitude_curves` reads
    from the fitted record, so that a candidate and the record itself are read in the same way.
    """
    found = branch.store.read(f"mode/{branch.path}")
    if found.outcome != OK:
        raise Refusal(following(found.name, found.outcome))
    seen = branch.record.seen
    try:
        read = amplitude_curves(replace(branch.record.signal, y=found.arrays["fit"]), seen)
    except Refusal:
        read = None  # a candidate whose motion does not swing
    grid = amplitude_grid(seen)
    if read is not None:
        ends = min(grid.min(), read.amplitude.min()), max(grid.max(), read.amplitude.max())
        grid = np.geomspace(*ends, grid.size)
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
    if read is not None:
        for what, at_points in undamped(read.amplitude).items():
            off = getattr(read, what) - at_points
            known = np.isfinite(off)
            if np.any(known):
                order = np.argsort(read.amplitude[known])
                arrays[what] = arrays[what] + np.interp(
                    np.log(grid), np.log(read.amplitude[known][order]), off[known][order]
                )
    return Product(None, {"amplitude": grid, **arrays})
