"""The records of the contest: five groups of simulated ones, in turn, so that the first n are of all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from validation.truth import discrepancies
from validation.truth.drawing import log_uniform
from validation.truth.records import FAMILY, FROM_END, Case, case

GROUPS = ("family", "discrepant", "noisy", "short", "gappy")
NOISE = (0.05, 0.15)
"""Range of the noise's sd in noisy records, of the first amplitude."""
SHORT = (3.0, 6.0)
"""Range of the cycles that are kept of short records."""
GAPS, LOST = 3, 0.4
"""How many gaps a gappy record has, and which share of its time they take together."""
APART = 1000
"""Numbers of the groups begin so far apart: no two have an oscillator in common."""


@dataclass(frozen=True, eq=False)
class Record:
    """A record and what is true of it.

    t in s and y in rad, shape (n,). amplitudes: rad, largest first; ratios: equivalent damping ratios there. damping:
    the true sum, empty where it is not known. kind: the discrepancy, else the group.
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


def simulated(seed: int, number: int) -> Record:
    """Record `number` of a seed: truth by SciPy's DOP853, as in `validation.truth.records`.

    Its group is `GROUPS[number % 5]`. family: seven damping sums by four restoring laws, noise of 0.3 to 3 % of the
    first amplitude, 8 to 60 cycles. discrepant: ten ways off the laws, in turn. noisy: with noise of 5 to 15 %. short:
    the first 3 to 6 cycles. gappy: three gaps of 40 % of the time together.
    """
    group, again = GROUPS[number % len(GROUPS)], number // len(GROUPS)
    rng = np.random.default_rng([seed, number])
    if group == "discrepant":
        kinds = list(discrepancies.KINDS)
        made = case(kinds[again % len(kinds)], seed, again // len(kinds))
    else:
        made = case(FAMILY, seed, APART * GROUPS.index(group) + again)
    t, y = made.signal.t, made.signal.y
    if group == "noisy":
        wanted = log_uniform(rng, *NOISE) * made.ratio.amplitude_at(
            max(_start(made), float(made.ratio.cycles[0]))
        )
        y = y + np.sqrt(max(wanted**2 - made.noise_sd**2, 0.0)) * rng.standard_normal(y.size)
    if group == "gappy":
        kept = np.all([(t < a) | (t > b) for a, b in _gaps(rng, float(t[-1]))], axis=0)
        t, y = t[kept], y[kept]
    amplitudes = made.amplitudes
    if group == "short":
        cycles = float(rng.uniform(*SHORT))
        kept = t <= t[-1] * cycles / made.cycles
        t, y = t[kept], y[kept]
        first, last = amplitudes[0], made.ratio.amplitude_at(_start(made) + cycles - FROM_END)
        amplitudes = (first, float(np.sqrt(first * last)), last)
    ratios = tuple(made.ratio(a) for a in amplitudes)
    kind = made.kind if group == "discrepant" else group
    return Record(
        f"{group}-{seed}-{again}", group, kind, t, y, amplitudes, ratios, made.damping, made.restoring
    )


def closed_form(ratio: float = 0.02, noise: float = 0.0, cycles: float = 20.0) -> Record:
    """The decay of a linear viscous oscillator of 1 Hz, released at rest 0.5 rad from its rest at 0.3 rad.

    ratio: of damping; noise: its sd, rad; cycles: the record's length.
    """
    t = np.arange(0.0, cycles, 0.02)
    omega, damped = 2 * np.pi, 2 * np.pi * np.sqrt(1 - ratio**2)
    y = np.exp(-ratio * omega * t) * (np.cos(damped * t) + ratio * omega / damped * np.sin(damped * t))
    y = 0.3 + 0.5 * y + noise * np.random.default_rng(0).standard_normal(t.size)
    amplitudes = tuple(0.5 * float(np.exp(-ratio * omega * x * cycles)) for x in (0.1, 0.5, 0.8))
    return Record("closed-form", "closed form", "", t, y, amplitudes, (ratio,) * 3, "viscous", "linear")


def _start(made: Case) -> float:
    """Cycles from the release to the record's first sample."""
    return float(np.interp(-made.amplitudes[0], -made.ratio.amplitude, made.ratio.cycles)) - FROM_END


def _gaps(rng: np.random.Generator, duration: float) -> list[tuple[float, float]]:
    """Begin and end of each gap, s, with a tenth or more of the samples that are left at either end and between."""
    left = 1 - LOST
    pieces = 0.1 * left + 0.6 * left * rng.dirichlet(np.ones(GAPS + 1))
    begins = np.cumsum(pieces[:-1]) + LOST / GAPS * np.arange(GAPS)
    return [(duration * a, duration * (a + LOST / GAPS)) for a in begins]
