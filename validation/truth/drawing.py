"""Oscillators and ways of recording them, drawn broadly from a generator of random numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from validation.truth.oscillator import LAWS, Oscillator
from validation.truth.rivals import loss_rate

EPSILON = 0.02
"""Velocity within which Coulomb friction turns over where it does, as a share of the peak velocity."""
MIDDLE = 0.75
"""Share of the first amplitude at which shares of the energy are drawn: most energy is lost near the start."""
FLOOR = 0.2
"""Least share of a term there; over the record a share may be somewhat less."""


@dataclass(frozen=True)
class Draw:
    """What a record is to be.

    displacement: at the release, from the equilibrium, rad, signed; frequency: of small motions, rad/s; cycles: length
    of the record in periods of small motions; per_cycle: samples in such a period; begin: when the record begins, s
    after the release; left: share of the amplitude meant to be left at the end; noise: its sd as a share of the
    displacement; taken: share of the loss at MIDDLE that is left to a further term.
    """

    oscillator: Oscillator
    displacement: float
    frequency: float
    cycles: float
    per_cycle: float
    begin: float
    left: float
    noise: float
    taken: float = 0.0

    @property
    def amplitude(self) -> float:
        """The first amplitude, rad."""
        return abs(self.displacement)

    @property
    def duration(self) -> float:
        """Of the record, s."""
        return 2 * np.pi * self.cycles / self.frequency


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is uniform between low and high."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def drawn(rng: np.random.Generator, damping: str, restoring: str, taken: float = 0.0) -> Draw:
    """An oscillator of this damping sum and restoring law, and how it is recorded.

    taken: share of the loss at MIDDLE that is left for another term, which the caller adds.
    Amplitudes are 0.05 to 1 rad (a pendulum's from 0.1 rad), frequencies 0.5 to 40 rad/s, rest angles within 1 rad;
    a Duffing spring's cubic is −0.25 to 0.6 of its stiffness at the first amplitude, gravity 2 to 90 % of stiffness.
    """
    frequency = log_uniform(rng, 0.5, 40.0)
    amplitude = log_uniform(rng, 0.1 if restoring == "pendulum" else 0.05, 1.0)
    displacement = amplitude * float(rng.choice([-1.0, 1.0]))
    cycles = float(rng.uniform(8.0, 60.0))
    left = log_uniform(rng, 0.1, 0.7)
    terms = damping.split("+")
    spread = rng.dirichlet(np.ones(len(terms)))
    least = FLOOR * (1 - taken)
    shares = least + (1 - taken - least * len(terms)) * spread
    sharp = rng.random() < 0.5
    oscillator = Oscillator(
        restoring,
        _spring(rng, restoring, frequency, amplitude),
        _coefficients(
            dict(zip(terms, shares.tolist(), strict=True)), taken, amplitude, frequency, cycles, left
        ),
        0.0 if sharp or "coulomb" not in terms else EPSILON * amplitude * frequency,
    )
    at_release = rng.random() < 0.5
    begin = 0.0 if at_release else float(rng.uniform(0.0, np.pi / frequency))
    return Draw(
        oscillator, displacement, frequency, cycles, log_uniform(rng, 16.0, 200.0), begin, left,
        log_uniform(rng, 0.003, 0.03), taken,
    )  # fmt: skip


def _spring(rng: np.random.Generator, law: str, frequency: float, amplitude: float) -> dict[str, float]:
    stiffness, rest = frequency**2, float(rng.uniform(-1.0, 1.0))
    if law == "horizontal_pendulum":
        share = log_uniform(rng, 0.02, 0.9) * float(rng.choice([-1.0, 1.0]))
        k = stiffness / (1 + share * np.sin(rest))
        values = (k, rest - share * np.cos(rest), share * k)
    else:
        values = (stiffness, rest, float(rng.uniform(-0.25, 0.6)) * stiffness / amplitude**2)
    return {name: float(value) for name, value in zip(LAWS[law], values, strict=False)}


def _coefficients(
    shares: Mapping[str, float], taken: float, amplitude: float, frequency: float, cycles: float, left: float
) -> dict[str, float]:
    """Coefficients with these shares in the loss at MIDDLE that leave this share of the amplitude."""
    unit = {t: s / float(loss_rate(t, MIDDLE * amplitude, frequency)) for t, s in shares.items()}
    grid = np.geomspace(left, 1.0, 200) * amplitude
    ratio = taken + sum(np.asarray(c * loss_rate(t, grid, frequency)) for t, c in unit.items())
    scale = np.trapezoid(1 / (grid * ratio), grid) / (2 * np.pi * cycles)
    return {term: float(scale * c) for term, c in unit.items()}


def middle_ratio(draw: Draw) -> float:
    """Equivalent damping ratio of the sum at MIDDLE of the first amplitude."""
    at = MIDDLE * draw.amplitude
    return float(sum(c * loss_rate(t, at, draw.frequency) for t, c in draw.oscillator.damping.items()))
