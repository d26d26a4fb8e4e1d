"""Answer simulated records of the damping terms that the paper does not have.

    python -m validation.experiments.laws TERM RECORDS SEED

prints a line for each record and counts, of all records and of those whose true sum can be distinguished from the best
sum that lacks one of its terms. `exponent` in place of a term draws power laws for the coverage of the exponent.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.integrate import quad

from bayesdamp.inference.deviation.draws import probabilities
from bayesdamp.inference.deviation.weighing import Weighing
from bayesdamp.interface.answer import WEIGHED, answer
from bayesdamp.physics.damping import all_sums
from bayesdamp.types import Signal
from bayesdamp.verdict.thresholds import DECIDED
from bayesdamp.verdict.types import Verdict
from validation.truth.motion import NoMotionError, solved
from validation.truth.oscillator import Discrepancy, Oscillator

EXPONENT = "exponent"
Force = Callable[[float, float, float], float]
LEAST_SHARE, LEAST_FALL = 0.3, 0.6
LEAST_NATS = 12.0
"""Least lead over the best rival with which a damping can be named."""


@dataclass(frozen=True)
class Truth:
    """A damping term.

    Attributes
    ----------
    coefficient : str
        Name of its coefficient.
    force : callable
        Force per unit of the coefficient, from the displacement, the velocity and the sign of the velocity.
    further : dict
        True values of its other parameters.
    static : callable
        Largest force at rest per unit of the coefficient, from the displacement.
    """

    coefficient: str
    force: Force
    further: dict[str, float] = field(default_factory=dict)
    static: Callable[[float], float] = field(default=lambda x: 0.0)


def truth_of(term: str, rng: np.random.Generator, size: float, speed: float) -> Truth:
    """Draw the parameters of a term for motions of this amplitude and peak velocity."""
    match term:
        case "cubic":
            return Truth("mu_3", lambda x, v, turn: v**3)
        case "displacement":
            return Truth("c_xxv", lambda x, v, turn: x * x * v)
        case "structural":
            return Truth("kappa", lambda x, v, turn: abs(x) * turn)
        case "stribeck":
            excess, slow = rng.uniform(0.5, 1.5), rng.uniform(0.1, 0.5) * speed
            return Truth(
                "mu_k", lambda x, v, turn: (1 + excess * math.exp(-((v / slow) ** 2))) * turn,
                {"static_excess": excess, "stribeck_velocity": slow}, lambda x: 1 + excess,
            )  # fmt: skip
        case "dry_position":
            slope, bend = rng.uniform(-0.4, 0.4), rng.choice([rng.uniform(-0.6, -0.3), rng.uniform(0.5, 2.0)])

            def friction(x: float) -> float:
                return 1 + slope * x / size + bend * (x / size) ** 2

            return Truth(
                "mu_p", lambda x, v, turn: friction(x) * turn,
                {"friction_slope": slope, "friction_curvature": bend}, friction,
            )  # fmt: skip
        case "power":
            p = rng.choice([0.5, 1.5, 2.5]) + rng.uniform(-0.2, 0.2)
        case "exponent":
            p = rng.uniform(0.2, 2.5)
        case _:
            raise ValueError(term)
    return Truth("c_power", lambda x, v, turn: speed * abs(v / speed) ** p * turn, {"exponent": p})


@dataclass(frozen=True)
class Case:
    """A simulated record.

    Attributes
    ----------
    signal : Signal
        The record.
    damping : str
        The true sum.
    values : dict
        True values of its parameters, by name.
    share : float
        Share of the term in the energy loss.
    noise : float
        Standard deviation of the noise, in the unit of the record.
    """

    signal: Signal
    damping: str
    values: dict[str, float]
    share: float
    noise: float


def case(term: str, seed: int) -> Case:
    """Simulate a record of a term, alone or with viscous damping.

    Its amplitude falls by 60 to 88 % within 15 to 40 cycles, with noise of 0.5 to 2 % of the amplitude.
    """
    rng = np.random.default_rng(seed)
    while (record := _case(term, rng)) is None:
        pass
    return record


def _case(term: str, rng: np.random.Generator) -> Case | None:
    size, frequency = float(np.exp(rng.uniform(np.log(0.02), np.log(0.4)))), float(rng.uniform(1.5, 12.0))
    speed, cycles, left = size * frequency, float(rng.uniform(15, 40)), float(rng.uniform(0.12, 0.4))
    truth = truth_of(term, rng, size, speed)
    alone = term in ("power", EXPONENT) or rng.random() < 0.5
    share = 1.0 if alone else float(rng.uniform(0.3, 0.9))

    def ratio(a: float) -> float:
        """Return the damping ratio per unit of the coefficient at an amplitude."""

        def power(phase: float) -> float:
            v = a * frequency * math.sin(phase)
            return truth.force(a * math.cos(phase), v, math.copysign(1.0, v)) * v

        lost = sum(quad(power, low, high)[0] for low, high in pairwise(np.linspace(0, 2 * np.pi, 9)))
        return lost / (2 * np.pi * (frequency * a) ** 2 * frequency)

    rate = (1 - share) / share * ratio(size * math.sqrt(left))  # viscous ratio per unit of the coefficient
    grid = np.geomspace(size, left * size, 60)
    # dA/dn = −2π ratio A
    each = np.array([1 / (2 * np.pi * (ratio(a) + rate)) for a in grid])
    coefficient = float(np.sum(0.5 * (each[1:] + each[:-1]) * -np.diff(np.log(grid)))) / cycles
    zeta = coefficient * rate * frequency
    viscous = {} if alone else {"viscous": zeta}
    oscillator = Oscillator(
        "linear", {"stiffness": frequency**2, "rest_angle": float(rng.uniform(-0.1, 0.1)) * size}, viscous,
        discrepancy=Discrepancy(
            term, lambda x, v, turn: coefficient * truth.force(x, v, turn),
            static_friction=lambda x: coefficient * truth.static(x),
        ),
    )  # fmt: skip
    times = np.linspace(0, cycles * 2 * np.pi / frequency, int(cycles * rng.uniform(30, 60)))
    try:
        motion = solved(oscillator, size, frequency, float(times[-1]) + 1e-9)
    except NoMotionError:
        return None
    y, v = motion.at(times)
    if np.abs(motion.turns[-1]) > (1 - LEAST_FALL) * size:
        return None
    x = y - oscillator.equilibrium()
    own = np.array([truth.force(a, b, math.copysign(1.0, b)) * b for a, b in zip(x, v, strict=True)])
    part = coefficient * own.sum() / (coefficient * own.sum() + np.sum(2 * zeta * v * v))
    if part < LEAST_SHARE:
        return None
    noise = float(rng.uniform(0.005, 0.02)) * size
    values = {truth.coefficient: coefficient, **truth.further} | ({} if alone else {"zeta": zeta})
    signal = Signal(times, y + noise * rng.standard_normal(times.size))
    return Case(signal, term if alone else f"viscous+{term}", values, float(part), noise)


@dataclass(frozen=True)
class Row:
    """The answer on a record.

    Attributes
    ----------
    damping : str
        The true sum.
    nats : float
        Lead of the true sum, see `nats_ahead`.
    first : str
        The most probable sum.
    decided : bool
        Whether it is named without reservation.
    exact : float
        Probability of the true sum under exact laws.
    inside : dict
        Whether the interval of each true parameter contains its value.
    """

    damping: str
    nats: float
    first: str
    decided: bool
    exact: float
    inside: dict[str, bool]


def verdict_on(c: Case, term: str, sample: bool, results: dict[str, Weighing]) -> Verdict:
    """Answer a record with the paper's sums, and a term alone and with viscous damping; add to `results`."""
    sums = [*all_sums(), term, f"viscous+{term}"]
    return answer(c.signal, damping=sums, restoring=["linear"], sample=sample, weighings=results).verdict


def first_sum(verdict: Verdict) -> str:
    """Return the most probable sum."""
    return max((v.probability, v.damping) for v in (verdict, *verdict.rivals))[1]


def intervals_inside(verdict: Verdict, c: Case) -> dict[str, bool]:
    """Return whether the interval of each coefficient contains the truth; none if another sum is first."""
    return {
        q.name: bool(q.low <= c.values[q.name] <= q.high)
        for q in (verdict.coefficients if verdict.damping == c.damping else ())
        if q.name in c.values
    }


def row(term: str, seed: int) -> Row | None:
    """Answer a record from linear models, and by sampling if its true sum can be distinguished; None if refused."""
    c = case(term, seed)
    results: dict[str, Weighing] = {}
    verdict = verdict_on(c, term, False, results)
    if WEIGHED not in results:
        print(seed, c.damping, verdict.sentence, flush=True)
        return None
    nats = nats_ahead(results[WEIGHED], c)
    if nats >= LEAST_NATS:
        verdict = verdict_on(c, term, True, results)
    probability = probabilities(results[WEIGHED], True)
    exact = sum(
        p for candidate, p in probability.items() if set(candidate.damping) == set(c.damping.split("+"))
    )
    first, inside = first_sum(verdict), intervals_inside(verdict, c)
    print(
        seed, c.damping, f"{c.share:.2f} {nats:.1f} nats ->", first, f"{verdict.probability:.3f}", verdict.decided,
        f"exact {exact:.3f}", inside, flush=True,
    )  # fmt: skip
    return Row(c.damping, nats, first, verdict.decided, exact, inside)


def nats_ahead(weighing: Weighing, c: Case) -> float:
    """Return the lead of the true sum's best fit over that of every sum that lacks one of its terms, in nats.

    The laws are exact, and the noise is the true one.
    """
    true = set(c.damping.split("+"))
    squares = {frozenset(r.candidate.damping): r.fit.squares for r in weighing.results}
    if frozenset(true) not in squares:
        return float("nan")
    rival = min(value for terms, value in squares.items() if not true <= terms)
    return (rival - squares[frozenset(true)]) / (2 * c.noise**2 / weighing.data.thinned)


def run_exponents(records: int, seed: int) -> None:
    """Print the exponent of each of several power laws, and how many intervals contain the truth."""
    inside = 0
    for i in range(records):
        c = case(EXPONENT, seed + i)
        e = answer(c.signal, restoring=["linear"], sample=False).verdict.exponent  # is not sampled
        p = c.values["exponent"]
        contains = e is not None and e.low <= p <= e.high
        inside += contains
        print(seed + i, f"{p:.3f}", e and f"{e.value:.3f} ({e.low:.3f} {e.high:.3f})", contains, flush=True)
    print("exponent", records, inside, flush=True)


def main(term: str, records: int, seed: int) -> None:
    """Answer several records of a term, and print the counts."""
    if term == EXPONENT:
        run_exponents(records, seed)
        return
    rows = [r for i in range(records) if (r := row(term, seed + i)) is not None]
    distinct = [r for r in rows if r.nats >= LEAST_NATS]
    for name, chosen in (("all", rows), (f"at least {LEAST_NATS:g} nats", distinct)):
        counts = {
            "records": len(chosen),
            "the term first": sum(term in r.first.split("+") for r in chosen),
            "the sum first": sum(r.first == r.damping for r in chosen),
            "named, rightly": sum(r.decided and r.first == r.damping for r in chosen),
            "wrongly": sum(r.decided and r.first != r.damping for r in chosen),
            "named under exact laws, rightly": sum(r.exact >= DECIDED for r in chosen),
            "parameters": sum(len(r.inside) for r in chosen),
            "held": sum(sum(r.inside.values()) for r in chosen),
        }
        print(term, name, counts, flush=True)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
