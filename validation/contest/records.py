"""Simulate the records of the contest. Their groups alternate, so that the first five records are of all groups."""

from dataclasses import replace

import numpy as np

from bayesdamp.types import Signal
from validation.truth import discrepancies
from validation.truth.drawing import log_uniform
from validation.truth.ratio import RatioCurve
from validation.truth.records import FAMILY, FROM_END, Case, case

GROUPS = ("family", "discrepant", "noisy", "short", "gappy")
"""Names of the groups of simulated records, in turn; `simulate_record` explains them."""
NOISE = (0.05, 0.15)
"""Range of the standard deviation of the noise in records of the group "noisy", as a share of the first amplitude."""
SHORT = (3.0, 6.0)
"""Range of the number of cycles in records of the group "short"."""
GAPS, LOST = 3, 0.4
"""Number of gaps in a record of the group "gappy", and their share of its duration."""
APART = 1000
"""The groups number their oscillators from multiples of this, so that no two groups share an oscillator."""


def simulate_record(seed: int, number: int) -> Case:
    """Return record `number` of a seed, with the truth by SciPy's DOP853, as in `validation.truth.records`.

    Its group is `GROUPS[number % 5]`.

    - family: one of the seven sums of viscous, Coulomb and quadratic damping with one of four restoring laws, noise of
      0.3 to 3 % of the first amplitude, 8 to 60 cycles.
    - discrepant: as family, with an effect that no compared law contains, one of ten in turn.
    - noisy: noise of 5 to 15 %.
    - short: the first 3 to 6 cycles.
    - gappy: three gaps with 40 % of the time in total.
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
    """Draw begin and end of each gap in a record of this duration (s).

    Each piece before, between and after the gaps has a tenth or more of the remaining samples.
    """
    left = 1 - LOST
    pieces = 0.1 * left + 0.6 * left * rng.dirichlet(np.ones(GAPS + 1))
    begins = np.cumsum(pieces[:-1]) + LOST / GAPS * np.arange(GAPS)
    return [(duration * a, duration * (a + LOST / GAPS)) for a in begins]
