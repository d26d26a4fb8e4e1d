"""Draw random test cases: records that no law of the family fits, and records of the family with poor data."""

from __future__ import annotations

import numpy as np

from bayesdamp.types import Signal
from validation.misfit import records as rec
from validation.truth.drawing import log_uniform
from validation.truth.oscillator import SUMS
from validation.truth.records import Case

SAMPLES = 240
"""Number of samples of a record before gaps are cut out."""
OUTSIDE = (
    "beats", "two_modes", "driven", "clipped", "stiction", "drift", "wander", "cubic", "root", "damping_changes",
    "stiffness_changes",
)  # fmt: skip
"""Kinds of records that none of the compared damping sums and restoring laws (the family) fits."""
INSIDE = ("clean", "two_cycles", "coarse", "quantised", "outliers", "gaps", "slight_drift")
"""Kinds of records whose damping sum and restoring law are among those compared (the family), most with poor data."""


def draw_case(kind: str, number: int, seed: int) -> Case:
    """Simulate a random record of a kind, with angles in rad. Kind, number and seed determine it.

    A damping outside the family has its own name, such as "cubic". The standard deviation of the noise is 0.3 to 5 % of
    the amplitude.
    """
    rng = np.random.default_rng([seed, (*OUTSIDE, *INSIDE).index(kind), number])
    cycles = float(rng.uniform(6, 12))
    if kind == "two_cycles":
        cycles = float(rng.uniform(2.1, 2.4))
    if kind == "coarse":
        cycles = (SAMPLES - 1) / 16
    times = np.linspace(0.0, 2 * np.pi * cycles, SAMPLES)
    left = float(rng.uniform(0.15, 0.8))
    eps = log_uniform(rng, 0.003, 0.03)
    noise = log_uniform(rng, 0.003, 0.05)
    damping = str(rng.choice(SUMS))
    terms = damping.split("+")
    shares = dict(
        zip(terms, 0.25 + (1 - 0.25 * len(terms)) * rng.dirichlet(np.ones(len(terms))), strict=True)
    )

    clean, truth = _motion(kind, rng, times, cycles, damping, left, rec.damping_of(shares, cycles, left, eps))
    y = clean + noise * rng.standard_normal(SAMPLES)
    if kind == "clipped":
        level = rng.uniform(0.4, 0.9)
        y = np.clip(y, -level if rng.random() < 0.5 else -np.inf, level)
    if kind == "quantised":
        y = 0.1 * np.round(y / 0.1)
    if kind == "outliers":
        at = rng.choice(SAMPLES, round(SAMPLES * rng.uniform(0.01, 0.05)), replace=False)
        y[at] += rng.choice([-1.0, 1.0], at.size) * rng.uniform(0.3, 1.0, at.size)
    keep = np.ones(SAMPLES, bool)
    if kind == "gaps":  # their total length is constant, so that all these records have equally many samples
        for begin in rng.choice(7, 3, replace=False):
            first = 10 + 30 * int(begin) + int(rng.integers(0, 12))
            keep[first : first + 16] = False
    amplitude, frequency = log_uniform(rng, 0.05, 1.5), log_uniform(rng, 0.5, 40.0)
    rest = float(rng.normal(0.0, amplitude))
    signal = Signal(times[keep] / frequency, rest + amplitude * y[keep])
    return Case(f"{kind}-{seed}-{number}", kind, signal, truth)


def _motion(
    kind: str,
    rng: np.random.Generator,
    times: np.ndarray,
    cycles: float,
    damping: str,
    left: float,
    force: rec.Force,
) -> tuple[np.ndarray, str]:
    """Simulate the motion of a record of a kind; return the positions (n,) in normalised units, and the true damping.

    Parameters
    ----------
    kind, rng, times, cycles
        Kind of the record, generator of its random numbers, times (n,) and their number of cycles.
    damping, left, force
        A damping sum of the family, the fraction to which it reduces the amplitude, and its force. Kinds with another
        damping do not use the sum or the force.
    """

    def sign() -> float:
        return float(rng.choice([-1.0, 1.0]))

    match kind:
        case "beats":
            coupling = rng.uniform(1.0, 4.0) / cycles
            return rec.coupled(force, times, coupling, coupling * rng.uniform(-1.0, 1.0)), damping
        case "driven":
            size, phase = log_uniform(rng, 0.05, 0.4), rng.uniform(0, 2 * np.pi)
            frequency = rng.uniform(0.5, 1.6)
            # The steady motion without damping has the amplitude `size`, but the force is limited near resonance.
            drive = size * max(abs(1 - frequency**2), 0.02)
            return rec.single(force, times, drive=lambda t: drive * np.cos(frequency * t + phase)), damping
        case "stiction":
            over, speed = rng.uniform(1.5, 3.0), rng.uniform(0.03, 0.15)
            # Kinetic friction reduces the amplitude by 4 × kinetic in each cycle: the motion does not stop within the
            # record.
            kinetic = rng.uniform(0.6, 0.95) / (4 * cycles)
            return rec.sticking(kinetic, over * kinetic, speed, times), "stiction"
        case "cubic" | "root":
            return rec.single(rec.damping_of({kind: 1.0}, cycles, left), times), kind
        case "damping_changes":
            growth = sign() * rng.uniform(1.0, 2.5)  # of its logarithm over the record
            return rec.single(force, times, loss=lambda t: np.exp(growth * (t / times[-1] - 0.5))), damping
        case "stiffness_changes":
            growth = sign() * log_uniform(rng, 0.01, 0.1)
            return rec.single(force, times, stiffness=lambda t: 1 + growth * t / times[-1]), damping
    motion = rec.single(force, times)
    match kind:
        case "two_modes":
            ratio = -np.log(rng.uniform(0.15, 0.8)) / (2 * np.pi * cycles)
            size, frequency = log_uniform(rng, 0.05, 0.5), rng.uniform(1.3, 5.0)
            motion += size * np.exp(-ratio * times) * np.cos(frequency * times + rng.uniform(0, 2 * np.pi))
        case "drift":
            motion += sign() * log_uniform(rng, 0.1, 1.0) * times / times[-1]
        case "slight_drift":
            motion += sign() * log_uniform(rng, 0.01, 0.1) * times / times[-1]
        case "wander":
            turns, phase = rng.uniform(0.4, 3.0), rng.uniform(0, 2 * np.pi)
            motion += log_uniform(rng, 0.03, 0.4) * np.sin(2 * np.pi * turns * times / times[-1] + phase)
    return motion, damping
