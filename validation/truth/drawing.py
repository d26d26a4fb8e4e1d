"""Draw oscillators and recording conditions at random, over broad ranges."""

from dataclasses import dataclass

import numpy as np

from validation.truth.oscillator import LAWS, Oscillator

EPSILON = 0.02
"""Width of the smoothed sign in Coulomb friction (tanh instead of sign), as a fraction of the peak velocity."""
MIDDLE = 0.75
"""Amplitude, as a fraction of the first, at which the fractions of the energy loss that the damping terms cause are
drawn. Most energy is lost early."""
FLOOR = 0.2
"""Smallest fraction of the energy loss that a damping term causes at the amplitude `MIDDLE`; over the whole record it
may be somewhat less."""


@dataclass(frozen=True)
class Draw:
    """The oscillator and the recording conditions of a record.

    Attributes
    ----------
    oscillator : Oscillator
        The law of motion.
    displacement : float
        Signed displacement from the equilibrium at the release, rad.
    frequency : float
        Frequency of small motions, rad/s.
    cycles : float
        Length of the record in periods of small motions.
    per_cycle : float
        Number of samples in a period of small motions.
    begin : float
        Time from the release to the start of the record, s.
    left : float
        Intended ratio of the last amplitude to the first.
    noise : float
        Standard deviation of the noise, as a fraction of the displacement at the release.
    taken : float
        Fraction of the energy loss at the amplitude `MIDDLE` that is reserved for an additional damping term; 0 without
        one.
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
        """The length of the record, s."""
        return 2 * np.pi * self.cycles / self.frequency


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number between low and high whose logarithm is uniformly distributed."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def loss_rate(term: str, amplitude: float | np.ndarray, frequency: float) -> float | np.ndarray:
    """Return the equivalent damping ratio of a damping term with the coefficient 1, for a harmonic motion.

    term: "viscous", "coulomb" or "quadratic". amplitude: in rad. frequency: in rad/s.
    """
    if term == "viscous":
        return 1 / frequency + 0 * amplitude
    if term == "coulomb":
        return 2 / (np.pi * frequency**2 * amplitude)
    return 4 * amplitude / (3 * np.pi)


def draw_oscillator(rng: np.random.Generator, damping: str, restoring: str, taken: float = 0.0) -> Draw:
    """Draw an oscillator with this damping sum and restoring law, and its recording conditions.

    Amplitudes are 0.05 to 1 rad (from 0.1 rad for a pendulum), frequencies 0.5 to 40 rad/s, rest angles −1 to 1 rad. At
    the first amplitude, the cubic force of a Duffing spring is −0.25 to 0.6 times its linear force. For a horizontal
    pendulum, gravity is 2 to 90 % of the stiffness, with either sign.

    Parameters
    ----------
    rng : Generator
        Source of random numbers.
    damping, restoring : str
        The damping sum, such as "viscous+coulomb", and the restoring law, one of `LAWS`.
    taken : float
        Fraction of the energy loss at the amplitude `MIDDLE` that is reserved for an additional damping term, which the
        caller adds.
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
    stiffness, rest = frequency**2, float(rng.uniform(-1.0, 1.0))
    if restoring == "horizontal_pendulum":
        share = log_uniform(rng, 0.02, 0.9) * float(rng.choice([-1.0, 1.0]))
        k = stiffness / (1 + share * np.sin(rest))
        values = (k, rest - share * np.cos(rest), share * k)
    else:
        values = (stiffness, rest, float(rng.uniform(-0.25, 0.6)) * stiffness / amplitude**2)
    # Compute coefficients with these fractions of the loss; `scale` makes the amplitude fall to `left` times the first.
    unit = {
        term: share / float(loss_rate(term, MIDDLE * amplitude, frequency))
        for term, share in zip(terms, shares.tolist(), strict=True)
    }
    grid = np.geomspace(left, 1.0, 200) * amplitude
    ratio = taken + sum(np.asarray(c * loss_rate(term, grid, frequency)) for term, c in unit.items())
    scale = np.trapezoid(1 / (grid * ratio), grid) / (2 * np.pi * cycles)
    oscillator = Oscillator(
        restoring,
        {name: float(value) for name, value in zip(LAWS[restoring], values, strict=False)},
        {term: float(scale * c) for term, c in unit.items()},
        0.0 if sharp or "coulomb" not in terms else EPSILON * amplitude * frequency,
    )
    at_release = rng.random() < 0.5
    begin = 0.0 if at_release else float(rng.uniform(0.0, np.pi / frequency))
    return Draw(
        oscillator, displacement, frequency, cycles, log_uniform(rng, 16.0, 200.0), begin, left,
        log_uniform(rng, 0.003, 0.03), taken,
    )  # fmt: skip


def middle_ratio(draw: Draw) -> float:
    """Return the equivalent damping ratio of the oscillator's damping sum at `MIDDLE` times the first amplitude."""
    at = MIDDLE * draw.amplitude
    return float(sum(c * loss_rate(t, at, draw.frequency) for t, c in draw.oscillator.damping.items()))
