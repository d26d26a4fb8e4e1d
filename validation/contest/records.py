"""Simulate the records of the contest. Their groups alternate, so that the first five records are of all groups."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from validation.scoring import in_columns
from validation.truth import discrepancies
from validation.truth.drawing import log_uniform
from validation.truth.records import FAMILY, FROM_END, Case, case

GROUPS = ("family", "discrepant", "noisy", "short", "gappy")
NOISE = (0.05, 0.15)
"""Range of the standard deviation of the noise in records of the group "noisy", as a share of the first amplitude."""
SHORT = (3.0, 6.0)
"""Range of the number of cycles in records of the group "short"."""
GAPS, LOST = 3, 0.4
"""Number of gaps in a record of the group "gappy", and their share of its duration."""
APART = 1000
"""The groups number their oscillators from multiples of this, so that no two groups share an oscillator."""


@dataclass(frozen=True, eq=False)
class Record:
    """A record and its truth.

    Attributes
    ----------
    name, group : str
        Name and group of the record.
    kind : str
        The discrepancy of a discrepant record, else the group.
    t, y : (n,) arrays
        Times in s and displacements in rad.
    amplitudes, ratios : tuple of float
        Amplitudes in rad, largest first, and the true equivalent damping ratios at these amplitudes.
    damping, restoring : str
        The true sum and the true law; empty if unknown.
    """

    name: str
    group: str
    kind: str
    t: np.ndarray
    y: np.ndarray
    amplitudes: tuple[float, ...]
    ratios: tuple[float, ...]
    damping: str = ""
    restoring: str = ""

    @property
    def truth(self) -> dict[str, float]:
        """The amplitudes (rad) and the true damping ratios there, by column of the table: amplitude_1, ratio_1, …"""
        return in_columns(amplitude=self.amplitudes, ratio=self.ratios)


def simulate_record(seed: int, number: int) -> Record:
    """Return record `number` of a seed, with the truth by SciPy's DOP853, as in `validation.truth.records`.

    Its group is `GROUPS[number % 5]`.

    - family: seven damping sums by four restoring laws, noise of 0.3 to 3 % of the first amplitude, 8 to 60 cycles.
    - discrepant: ten discrepancies from the laws, in turn.
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
    t, y = truth.signal.t, truth.signal.y
    if group == "noisy":
        wanted = log_uniform(rng, *NOISE) * truth.ratio.amplitude_at(
            max(_start(truth), float(truth.ratio.cycles[0]))
        )
        y = y + np.sqrt(max(wanted**2 - truth.noise_sd**2, 0.0)) * rng.standard_normal(y.size)
    if group == "gappy":
        inside = np.all([(t < a) | (t > b) for a, b in _gaps(rng, float(t[-1]))], axis=0)
        t, y = t[inside], y[inside]
    amplitudes = truth.amplitudes
    if group == "short":
        cycles = float(rng.uniform(*SHORT))
        inside = t <= t[-1] * cycles / truth.cycles
        t, y = t[inside], y[inside]
        first, last = amplitudes[0], truth.ratio.amplitude_at(_start(truth) + cycles - FROM_END)
        amplitudes = (first, float(np.sqrt(first * last)), last)
    ratios = tuple(truth.ratio(a) for a in amplitudes)
    kind = truth.kind if group == "discrepant" else group
    return Record(
        f"{group}-{seed}-{again}", group, kind, t, y, amplitudes, ratios, truth.damping, truth.restoring
    )


def closed_form(ratio: float = 0.02, noise: float = 0.0, cycles: float = 20.0) -> Record:
    """Return a decay of a linear viscous oscillator of 1 Hz, released at rest 0.5 rad from its equilibrium at 0.3 rad.

    Parameters
    ----------
    ratio : float
        Damping ratio.
    noise : float
        Standard deviation of the noise, rad.
    cycles : float
        Length of the record in cycles.
    """
    t = np.arange(0.0, cycles, 0.02)
    omega, damped = 2 * np.pi, 2 * np.pi * np.sqrt(1 - ratio**2)
    y = np.exp(-ratio * omega * t) * (np.cos(damped * t) + ratio * omega / damped * np.sin(damped * t))
    y = 0.3 + 0.5 * y + noise * np.random.default_rng(0).standard_normal(t.size)
    amplitudes = tuple(0.5 * float(np.exp(-ratio * omega * x * cycles)) for x in (0.1, 0.5, 0.8))
    return Record("closed-form", "closed form", "", t, y, amplitudes, (ratio,) * 3, "viscous", "linear")


def _start(truth: Case) -> float:
    """Return the number of cycles from the release to the first sample of the record."""
    return float(np.interp(-truth.amplitudes[0], -truth.ratio.amplitude, truth.ratio.cycles)) - FROM_END


def _gaps(rng: np.random.Generator, duration: float) -> list[tuple[float, float]]:
    """Draw begin and end of each gap in a record of this duration (s).

    Each piece before, between and after the gaps has a tenth or more of the remaining samples.
    """
    left = 1 - LOST
    pieces = 0.1 * left + 0.6 * left * rng.dirichlet(np.ones(GAPS + 1))
    begins = np.cumsum(pieces[:-1]) + LOST / GAPS * np.arange(GAPS)
    return [(duration * a, duration * (a + LOST / GAPS)) for a in begins]
