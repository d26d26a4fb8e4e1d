"""Simulate the records of the contest. Their groups alternate, so that each group is among the first five records."""

from dataclasses import replace

import numpy as np

from bayesdamp.types import Signal
from validation.truth import discrepancies
from validation.truth.drawing import log_uniform
from validation.truth.ratio import RatioCurve
from validation.truth.records import FAMILY, FROM_END, Case, case

GROUPS = ("family", "discrepant", "noisy", "short", "gappy")
"""Names of the groups of simulated records, to which successive records belong in turn; `simulate_record` explains
them."""
NOISE = (0.05, 0.15)
"""Range of the standard deviation of the noise in records of the group "noisy", as a fraction of the first
amplitude."""
SHORT = (3.0, 6.0)
"""Range of the number of cycles in records of the group "short"."""
GAPS, LOST = 3, 0.4
"""Number of gaps in a record of the group "gappy", and the fraction of its duration that they have together."""
APART = 1000
"""The oscillators of each group are numbered from a multiple of this, so that no two groups contain the same one."""


def simulate_record(seed: int, number: int) -> Case:
    """Simulate record `number` of a seed; return it with its truth, which SciPy's DOP853 computes.

    Its group is `GROUPS[number % 5]`.

    - family: one of the seven sums of viscous, Coulomb and quadratic damping with one of four restoring laws. The noise
      is 0.3 to 3 % of the first amplitude; the record has 8 to 60 cycles.
    - discrepant: as family, with one of ten effects in turn that none of the compared laws contains.
    - noisy: as family, with noise of 5 to 15 %.
    - short: as family, but only the first 3 to 6 cycles.
    - gappy: as family, with three gaps that have 40 % of the duration in total.
    """
    group, again = GROUPS[number % len(GROUPS)], number // len(GROUPS)
    rng = np.random.default_rng([seed, number])
    if group == "discrepant":
        kinds = list(discrepancies.KINDS)
        truth = case(kinds[again % len(kinds)], seed, again // len(kinds))
    else:
        truth = case(FAMILY, seed, APART * GROUPS.index(group) + again)
    t, y, amplitudes, curve = truth.signal.t, truth.signal.y, truth.amplitudes, truth.ratio
    assert isinstance(curve, RatioCurve)
    # Cycles from the release to the first sample.
    start = float(np.interp(-amplitudes[0], -curve.amplitude, curve.cycles)) - FROM_END
    if group == "noisy":
        wanted = log_uniform(rng, *NOISE) * curve.amplitude_at(max(start, float(curve.cycles[0])))
        y = y + np.sqrt(max(wanted**2 - truth.noise_sd**2, 0.0)) * rng.standard_normal(y.size)
    if group == "gappy":
        inside = np.all([(t < a) | (t > b) for a, b in _gaps(rng, float(t[-1]))], axis=0)
        t, y = t[inside], y[inside]
    if group == "short":
        cycles = float(rng.uniform(*SHORT))
        inside = t <= t[-1] * cycles / truth.cycles
        t, y = t[inside], y[inside]
        first, last = amplitudes[0], curve.amplitude_at(start + cycles - FROM_END)
        amplitudes = (first, float(np.sqrt(first * last)), last)
    return replace(
        truth, name=f"{group}-{seed}-{again}", group=group, signal=Signal(t, y), amplitudes=amplitudes
    )


def _gaps(rng: np.random.Generator, duration: float) -> list[tuple[float, float]]:
    """Draw the gaps in a record that begins at time 0; return the start and end of each gap in s.

    duration: duration of the record in s. Each of the four pieces before, between and after the gaps has a tenth or
    more of the remaining time.
    """
    left = 1 - LOST
    pieces = 0.1 * left + 0.6 * left * rng.dirichlet(np.ones(GAPS + 1))
    begins = np.cumsum(pieces[:-1]) + LOST / GAPS * np.arange(GAPS)
    return [(duration * a, duration * (a + LOST / GAPS)) for a in begins]
