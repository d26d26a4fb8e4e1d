"""Simulate records with a known truth, with or without a discrepancy from all laws that are compared."""

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from bayesdamp.types import Signal
from validation.truth import discrepancies
from validation.truth.discrepancies import COULOMB, SHARE, TAKING
from validation.truth.drawing import Draw, draw_oscillator
from validation.truth.motion import Motion, NoMotionError, solve_motion
from validation.truth.oscillator import COEFFICIENTS, LAWS, SUMS, Discrepancy
from validation.truth.ratio import ratio_curve
from validation.truth.rivals import nats_ahead

FAMILY = "family"
"""Kind of the records for which one of the compared damping sums and restoring laws holds exactly."""
KINDS = (FAMILY, *discrepancies.KINDS)
"""All kinds of records: the family, for which a compared law holds exactly, and one kind for each discrepancy from
these laws."""
NATS = 12.0
"""Smallest difference in log likelihood (nats) between the true damping sum of a record and the best sum that lacks one
of its terms. If the difference is smaller, the record is drawn again."""
LEAST_SHARE, CYCLES, LEFT = 0.15, (8.0, 60.0), (0.1, 0.7)
"""Conditions for a record: smallest fraction of the energy loss that each term causes, range of the number of cycles,
and range of the last amplitude divided by the first."""
FROM_END = 0.75
"""Answers are judged at the amplitudes that the motion has this number of cycles after the start and before the end of
the record."""
PER_CYCLE = 64
"""Number of points in a cycle at which the power of each damping term is evaluated, to compute its part of the energy
loss."""


@dataclass(frozen=True, eq=False)
class Case:
    """A record and its truth. A part of the truth that is unknown or not needed has its default value.

    Attributes
    ----------
    name, group : str
        Name of the record, and the group in which it is scored.
    signal : Signal
        The record, without the truth.
    damping : str
        The true damping sum, such as "viscous+coulomb". In a record by `case`, it does not contain the extra damping
        force of a discrepancy.
    restoring : str
        The true restoring law.
    ratio : callable, optional
        The equivalent damping ratio as a function of the amplitude, which is in the unit of the record.
    amplitudes : tuple of float
        The amplitudes at which an answer is judged, largest first. In a record by `case` they are those at 0.75 cycles
        from either end of the record, and the geometric mean of these two.
    parameters : mapping
        The damping coefficients (zeta, mu_c, mu_q), the parameters of the restoring law, the width of the smoothed sign
        (epsilon), and angle and velocity at the start of the record (theta0, omega0), in SI units.
    noise_sd : float
        Standard deviation of the noise, in the unit of the record.
    shares : mapping
        Fraction of the energy loss that each damping term causes, by term.
    nats : float
        By how many nats (difference in log likelihood) the true damping sum fits better than every sum that lacks one
        of its terms: half the smallest sum of squares of these sums, divided by the noise variance. It is computed for
        the motion without its discrepancy and without oversampling.
    cycles : float
        Cycles in the record.
    """

    name: str
    group: str
    signal: Signal
    damping: str
    restoring: str = "linear"
    ratio: Callable[[float], float] | None = None
    amplitudes: tuple[float, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    noise_sd: float = math.nan
    shares: Mapping[str, float] = field(default_factory=dict)
    nats: float = math.nan
    cycles: float = math.nan


def case(kind: str, seed: int, number: int, oversample: int = 1) -> Case:
    """Simulate record `number` of a kind and seed; the seven damping sums and four restoring laws alternate.

    Each damping term causes 15 % or more of the energy loss. The amplitude falls to 10 to 70 %. The standard deviation
    of the white noise is 0.3 to 3 % of the first amplitude. The record has 8 to 60 cycles with 16 to 200 samples each.
    The true damping sum fits better by 12 nats or more (difference in log likelihood) than every sum that lacks one of
    its terms. A draw that does not satisfy these conditions is repeated.

    Parameters
    ----------
    kind : str
        FAMILY, or a discrepancy of `discrepancies.KINDS`, whose docstrings give its size.
    seed : int
        Seed of the random numbers.
    number : int
        Number of the record under this seed.
    oversample : int
        Factor by which the same motion is sampled faster; the noise of a sample does not change.
    """
    rng = np.random.default_rng([seed, KINDS.index(kind), number])
    damping, restoring = in_turn(kind, number)
    for _ in range(400):
        draw = draw_oscillator(rng, damping, restoring, float(rng.uniform(*SHARE)) if kind in TAKING else 0.0)
        own = np.random.default_rng(rng.integers(2**63))
        with suppress(NoMotionError):
            return _simulate(name_of(kind, seed, number, oversample), kind, draw, own, oversample)
    raise RuntimeError(f"none of 400 random draws of a record of kind {kind} satisfies the conditions")


def name_of(kind: str, seed: int, number: int, oversample: int = 1) -> str:
    """Return the name of a record, such as `family-903-12`, or `family-903-12-x10` with ten times the sampling rate."""
    return f"{kind}-{seed}-{number}" + (f"-x{oversample}" if oversample > 1 else "")


def in_turn(kind: str, number: int) -> tuple[str, str]:
    """Return the damping sum and the restoring law of record `number` of a kind.

    The records of a kind go through all pairs of sum and law in turn; each kind starts with another pair.
    """
    sums = [name for name in SUMS if kind not in COULOMB or "coulomb" in name.split("+")]
    begin = KINDS.index(kind)
    again = number // len(sums) if len(sums) == len(LAWS) else 0  # with seven sums, all pairs occur anyway
    return sums[(number + 3 * begin) % len(sums)], list(LAWS)[(number + again + begin) % len(LAWS)]


def _simulate(name: str, kind: str, draw: Draw, rng: np.random.Generator, oversample: int) -> Case:
    """Simulate the record of a draw. Raises NoMotionError if it does not satisfy the conditions in `case`."""
    if (nats := nats_ahead(draw)) < NATS:
        raise NoMotionError("a sum without one of the true terms fits as well")
    observe = Motion.displacements
    if kind != FAMILY:
        odd = discrepancies.KINDS[kind](rng, draw)
        if isinstance(odd, Discrepancy):
            draw = replace(draw, oscillator=replace(draw.oscillator, discrepancy=odd))
        else:
            observe = odd
    o, end = draw.oscillator, draw.begin + draw.duration
    motion = solve_motion(o, draw.displacement, draw.frequency, end)
    count = np.interp([draw.begin, end], motion.turn_times, 0.5 * np.arange(motion.turns.size))
    cycles = float(count[1] - count[0])
    sizes = np.interp([draw.begin, end], motion.turn_times, np.abs(motion.turns))
    shares = _shares(draw, motion, end)
    if not (
        CYCLES[0] <= cycles <= CYCLES[1]
        and LEFT[0] <= sizes[1] / sizes[0] <= LEFT[1]
        and min(shares[term] for term in o.damping) >= LEAST_SHARE
    ):
        raise NoMotionError(
            "the number of cycles, the decay, or the share of a term is too small or too large"
        )
    curve = ratio_curve(motion, o.potential())
    first, last = (curve.amplitude_at(float(n)) for n in (count[0] + FROM_END, count[1] - FROM_END))

    gap = 2 * np.pi / (draw.frequency * draw.per_cycle * oversample)
    times = gap * np.arange(int(draw.duration / gap) + 1)
    clean = motion.equilibrium + observe(motion, draw.begin + times)
    noise_sd = draw.noise * draw.amplitude
    start = motion.at(np.array([draw.begin]))
    parameters = {COEFFICIENTS[term]: c for term, c in o.damping.items()} | dict(o.parameters)
    parameters |= {"epsilon": o.epsilon, "theta0": float(start[0][0]), "omega0": float(start[1][0])}
    return Case(
        name, kind, Signal(times, clean + noise_sd * rng.standard_normal(times.size)), "+".join(o.damping), o.restoring,
        curve, (first, float(np.sqrt(first * last)), last), parameters, noise_sd, shares, nats, cycles,
    )  # fmt: skip


def _shares(draw: Draw, motion: Motion, end: float) -> dict[str, float]:
    """Return the fraction of the energy loss over the record that each damping term causes, by term.

    The extra damping force of a discrepancy is one of the terms. draw: oscillator and recording conditions. motion: the
    solved motion. end: time at which the record ends, in s since the release.
    """
    o, odd = draw.oscillator, draw.oscillator.discrepancy
    times = np.linspace(draw.begin, end, round(PER_CYCLE * draw.cycles))
    theta, v = motion.at(times)
    turn = np.tanh(v / o.epsilon) if o.epsilon else np.sign(v)
    forces = {"viscous": 2 * v, "coulomb": turn, "quadratic": v * np.abs(v)}
    forces = {term: c * forces[term] for term, c in o.damping.items()}
    x = (theta - motion.equilibrium).tolist()
    extra = [odd.damping(*state) for state in zip(x, v.tolist(), turn.tolist(), strict=True)]
    scale = np.array([odd.scale(t) for t in times])
    lost = {
        term: float(np.mean(scale * force * v))
        for term, force in (forces | {odd.term: np.array(extra)}).items()
    }
    total = sum(lost.values())
    return {term: value / total for term, value in lost.items()}
