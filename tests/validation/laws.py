"""Records of the damping terms beside the paper's, by the validation's own solver, and what is found on them.

    python -m tests.validation.laws TERM RECORDS SEED

prints a line a record and counts, of all records and of those whose true sum can be told from the best that lacks one
of its terms; `exponent` in place of a term draws power laws for the exponent's coverage.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import quad

from bayesdamp.inference.deviation.numbers.draws import probabilities
from bayesdamp.inference.deviation.weighing import Weighing
from bayesdamp.interface.answer import WEIGHED, answer
from bayesdamp.physics.damping import all_sums
from bayesdamp.types import Signal
from bayesdamp.verdict.thresholds import DECIDED
from bayesdamp.verdict.types import Verdict
from validation.truth.motion import NoMotionError, solved
from validation.truth.oscillator import Discrepancy, Oscillator

Force = Callable[[float, float, float], float]
LEAST_SHARE, LEAST_FALL = 0.3, 0.6
LEAST_NATS = 12.0
"""Ahead of the best rival, for less of which nobody can name a damping."""


@dataclass(frozen=True)
class Truth:
    """A force per unit of its coefficient of (displacement, velocity, sign of the velocity), what of it holds at rest,
    and the parameters beside the coefficient."""

    coefficient: str
    force: Force
    held: Callable[[float], float]
    further: dict[str, float]


def truth_of(term: str, rng: np.random.Generator, size: float, speed: float) -> Truth:
    """A term with parameters drawn for motions of this amplitude and peak velocity."""
    none = lambda x: 0.0  # noqa: E731
    match term:
        case "cubic":
            return Truth("mu_3", lambda x, v, turn: v**3, none, {})
        case "displacement":
            return Truth("c_xxv", lambda x, v, turn: x * x * v, none, {})
        case "structural":
            return Truth("kappa", lambda x, v, turn: abs(x) * turn, none, {})
        case "stribeck":
            excess, slow = rng.uniform(0.5, 1.5), rng.uniform(0.1, 0.5) * speed
            return Truth(
                "mu_k", lambda x, v, turn: (1 + excess * math.exp(-((v / slow) ** 2))) * turn,
                lambda x: 1 + excess, {"static_excess": excess, "stribeck_velocity": slow},
            )  # fmt: skip
        case "dry_position":
            slope, bend = rng.uniform(-0.4, 0.4), rng.choice([rng.uniform(-0.6, -0.3), rng.uniform(0.5, 2.0)])

            def friction(x: float) -> float:
                return 1 + slope * x / size + bend * (x / size) ** 2

            return Truth(
                "mu_p", lambda x, v, turn: friction(x) * turn, friction,
                {"friction_slope": slope, "friction_curvature": bend},
            )  # fmt: skip
        case "power" | "exponent":
            p = (
                rng.uniform(0.2, 2.5)
                if term == "exponent"
                else rng.choice([0.5, 1.5, 2.5]) + rng.uniform(-0.2, 0.2)
            )
            return Truth(
                "c_power", lambda x, v, turn: speed * abs(v / speed) ** p * turn, none, {"exponent": p}
            )
    raise ValueError(term)


@dataclass(frozen=True)
class Case:
    """A record, the sum that it is of, true values by name, the term's share of the energy, the sd of the noise."""

    signal: Signal
    damping: str
    values: dict[str, float]
    share: float
    noise: float


def case(term: str, seed: int) -> Case:
    """A record whose amplitude falls by 60 to 88 % within 15 to 40 cycles, the term alone or beside viscous damping,
    noise of 0.5 to 2 % of the amplitude."""
    rng = np.random.default_rng(seed)
    while True:
        found = _case(term, rng)
        if found is not None:
            return found


def _case(term: str, rng: np.random.Generator) -> Case | None:
    size, frequency = float(np.exp(rng.uniform(np.log(0.02), np.log(0.4)))), float(rng.uniform(1.5, 12.0))
    speed, cycles, left = size * frequency, float(rng.uniform(15, 40)), float(rng.uniform(0.12, 0.4))
    truth = truth_of(term, rng, size, speed)
    alone = term in ("power", "exponent") or rng.random() < 0.5
    share = 1.0 if alone else float(rng.uniform(0.3, 0.9))

    def ratio(a: float) -> float:
        """Per unit of the coefficient, at an amplitude."""

        def power(phase: float) -> float:
            v = a * frequency * math.sin(phase)
            return truth.force(a * math.cos(phase), v, math.copysign(1.0, v)) * v

        points = np.linspace(0, 2 * np.pi, 9)
        lost = sum(quad(power, one, two)[0] for one, two in pairwise(points))
        return lost / (2 * np.pi * (frequency * a) ** 2 * frequency)

    middle = size * math.sqrt(left)
    rate = (1 - share) / share * ratio(middle)  # viscous ratio per unit of the term's coefficient
    grid = np.geomspace(size, left * size, 60)
    # dA/dn = −2π ratio A
    each = np.array([1 / (2 * np.pi * (ratio(a) + rate)) for a in grid])
    needed = float(np.sum(0.5 * (each[1:] + each[:-1]) * -np.diff(np.log(grid))))
    coefficient = needed / cycles
    zeta = coefficient * rate * frequency
    oscillator = Oscillator(
        "linear", {"stiffness": frequency**2, "rest_angle": float(rng.uniform(-0.1, 0.1)) * size},
        {"viscous": zeta} if not alone else {},
        discrepancy=Discrepancy(
            term, lambda x, v, turn: coefficient * truth.force(x, v, turn),
            static_friction=lambda x: coefficient * truth.held(x),
        ),
    )  # fmt: skip
    times = np.arange(int(cycles * rng.uniform(30, 60))) * 0.0
    times = np.linspace(0, cycles * 2 * np.pi / frequency, times.size)
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


def main(term: str, records: int, seed: int) -> None:
    if term == "exponent":
        exponents(records, seed)
        return
    rows = [found for i in range(records) if (found := one(term, seed + i)) is not None]
    tellable = [r for r in rows if r.nats >= LEAST_NATS]
    for name, chosen in (("all", rows), (f"at least {LEAST_NATS:g} nats", tellable)):
        counts = {
            "records": len(chosen),
            "the term first": sum(term in r.first.split("+") for r in chosen),
            "the sum first": sum(r.first == r.damping for r in chosen),
            "named, rightly": sum(r.decided and r.first == r.damping for r in chosen),
            "wrongly": sum(r.decided and r.first != r.damping for r in chosen),
            "named under exact laws, rightly": sum(r.exact >= DECIDED for r in chosen),
            "parameters": sum(len(r.held) for r in chosen),
            "held": sum(sum(r.held.values()) for r in chosen),
        }
        print(term, name, counts, flush=True)


@dataclass(frozen=True)
class Row:
    """What is said of a record: the first sum, whether it is named outright, which true parameters their intervals
    hold; exact: the true sum's probability under exact laws. nats: how far the true sum is ahead, by the greatest
    likelihood under exact laws and the noise that the record has, of the best sum that lacks one of its terms."""

    damping: str
    nats: float
    first: str
    decided: bool
    exact: float
    held: dict[str, bool]


def one(term: str, seed: int) -> Row | None:
    """A record answered from linear models, and sampled where the true sum can be told; None where it is refused."""
    c = case(term, seed)
    made: dict[str, Weighing] = {}

    def said(sample: bool) -> Verdict:
        sums = [*all_sums(), term, f"viscous+{term}"]
        return answer(c.signal, damping=sums, restoring=["linear"], sample=sample, made=made).verdict

    v = said(False)
    if WEIGHED not in made:
        print(seed, c.damping, v.sentence, flush=True)
        return None
    nats = nats_ahead(made[WEIGHED], c)
    v = said(True) if nats >= LEAST_NATS else v
    exact = probabilities(made[WEIGHED], True)
    first = max([(v.probability, v.damping), *((r.probability, r.damping) for r in v.rivals)])[1]
    inside = {
        q.name: bool(q.low <= c.values[q.name] <= q.high)
        for q in v.coefficients
        if v.damping == c.damping and q.name in c.values
    }
    true = sum(p for candidate, p in exact.items() if set(candidate.damping) == set(c.damping.split("+")))
    row = Row(c.damping, nats, first, v.decided, true, inside)
    print(
        seed, c.damping, f"{c.share:.2f} {nats:.1f} nats ->", first, f"{v.probability:.3f}", v.decided,
        f"exact {true:.3f}", inside, flush=True,
    )  # fmt: skip
    return row


def nats_ahead(weighing: Weighing, c: Case) -> float:
    """Of the true sum's fit of the best one of those that lack a term of it."""
    true = set(c.damping.split("+"))
    squares = {frozenset(r.candidate.damping): r.fit.squares for r in weighing.results}
    if frozenset(true) not in squares:
        return float("nan")
    rival = min(value for terms, value in squares.items() if not true <= terms)
    return (rival - squares[frozenset(true)]) / (2 * c.noise**2 / weighing.data.thinned)


def exponents(records: int, seed: int) -> None:
    inside = 0
    for i in range(records):
        c = case("exponent", seed + i)
        e = answer(c.signal, restoring=["linear"], sample=False).verdict.exponent  # is not sampled
        p = c.values["exponent"]
        held = e is not None and e.low <= p <= e.high
        inside += held
        print(seed + i, f"{p:.3f}", e and f"{e.value:.3f} ({e.low:.3f} {e.high:.3f})", held, flush=True)
    print("exponent", records, inside, flush=True)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
