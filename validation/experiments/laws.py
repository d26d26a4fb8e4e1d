"""Answer simulated records with damping terms that are not in the paper, and write the page on the results.

`python -m validation.experiments.laws TABLE FOLDER [--seed 86000 --exponents 60 --each 6 --terms cubic power ...]`. The
term `exponent` means power laws with random exponents, for the coverage of the exponent's interval.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.integrate import quad

from bayesdamp.formatting import markdown_table as table
from bayesdamp.inference.deviation.draws import candidate_probabilities
from bayesdamp.inference.deviation.model_comparison import ModelComparison
from bayesdamp.interface.answer import COMPARED, answer
from bayesdamp.physics.damping import all_sums
from bayesdamp.types import Signal
from validation.rows import make_page, page_options, total, where
from validation.scoring import hits_of
from validation.truth.motion import NoMotionError, solve_motion
from validation.truth.oscillator import Discrepancy, Oscillator

EXPONENT = "exponent"
TERMS = ("cubic", "displacement", "power", "dry_position", "structural", "stribeck")
COLUMNS = (
    "case", "term", "truth", "share", "nats", "exact", "exponent", "exponent_low", "exponent_high", "first",
    "probability", "decided", "intervals", "held", "missed",
)  # fmt: skip
HEADS = (
    "term", "most probable", "true sum most probable", "named outright, correctly", "named outright, wrongly",
    "named correctly, of the distinguishable", "intervals with the truth",
)  # fmt: skip
Force = Callable[[float, float, float], float]
LEAST_SHARE, LEAST_FALL = 0.3, 0.6
LEAST_NATS = 12.0
"""A true sum counts as distinguishable if the log likelihood of its best fit is at least this much (nats) above that of
every sum that lacks one of its terms."""


@dataclass(frozen=True)
class Truth:
    """A damping term with its true parameters.

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
    """Draw the parameters of a term, except its coefficient, for motions of this amplitude and peak velocity.

    term: a name of `TERMS`, or "exponent". size, speed: amplitude (rad) and peak velocity (rad/s).
    """
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
        Share of the term in the energy that is lost over the record; 1 if it is alone.
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

    Its amplitude falls by 60 to 88 % within 15 to 40 cycles, with noise of 0.5 to 2 % of the amplitude. A draw that
    sticks, falls less, or whose term has less than 30 % of the loss is repeated.
    """
    rng = np.random.default_rng(seed)
    while True:
        try:
            return _simulate(term, rng)
        except NoMotionError:
            pass


def _simulate(term: str, rng: np.random.Generator) -> Case:
    """Draw and simulate one record as `case` describes. Raises NoMotionError if the draw breaks a rule named there."""
    size, frequency = float(np.exp(rng.uniform(np.log(0.02), np.log(0.4)))), float(rng.uniform(1.5, 12.0))
    speed, cycles, left = size * frequency, float(rng.uniform(15, 40)), float(rng.uniform(0.12, 0.4))
    truth = truth_of(term, rng, size, speed)
    alone = term in ("power", EXPONENT) or rng.random() < 0.5
    share = 1.0 if alone else float(rng.uniform(0.3, 0.9))

    def ratio(a: float) -> float:
        """Return the equivalent damping ratio at an amplitude, per unit of the coefficient."""

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
    motion = solve_motion(oscillator, size, frequency, float(times[-1]) + 1e-9)
    y, v = motion.at(times)
    if np.abs(motion.turns[-1]) > (1 - LEAST_FALL) * size:
        raise NoMotionError("it falls too little")
    x = y - oscillator.equilibrium()
    own = np.array([truth.force(a, b, math.copysign(1.0, b)) * b for a, b in zip(x, v, strict=True)])
    part = coefficient * own.sum() / (coefficient * own.sum() + np.sum(2 * zeta * v * v))
    if part < LEAST_SHARE:
        raise NoMotionError("the term has too small a share of the loss")
    noise = float(rng.uniform(0.005, 0.02)) * size
    values = {truth.coefficient: coefficient, **truth.further} | ({} if alone else {"zeta": zeta})
    signal = Signal(times, y + noise * rng.standard_normal(times.size))
    return Case(signal, term if alone else f"viscous+{term}", values, float(part), noise)


def nats_ahead(comparison: ModelComparison, c: Case) -> float:
    """Return by how many nats the best fit of the true sum is ahead of the best of all sums that lack one of its terms.

    It is the difference of the log likelihoods if the laws hold exactly, with the true noise. It is infinite if no such
    sum was fitted, because all were expected to be hopeless, and NaN if the true sum was not fitted.
    """
    true = set(c.damping.split("+"))
    squares = {frozenset(r.candidate.damping): r.fit.squares for r in comparison.results}
    if frozenset(true) not in squares:
        return float("nan")
    rival = min((value for terms, value in squares.items() if not true <= terms), default=math.inf)
    return (rival - squares[frozenset(true)]) / (2 * c.noise**2 / comparison.data.thinned)


def row(term: str, seed: int) -> dict[str, object]:
    """Simulate a record of a term and answer it; return the row of the table that compares the answer with the truth.

    For the term "exponent" the answer is the exponent of a power law, else the most probable sum and its intervals.

    The sums that are compared are the paper's seven, the term alone, and the term with viscous damping. The row also
    contains the probability of the true sum under exact laws, and the parameters whose intervals miss the truth.
    """
    c = case(term, seed)
    head = {"case": f"{term}-{seed}", "term": term, "share": c.share}
    if term == EXPONENT:
        e = answer(c.signal, restoring=["linear"], sample=False).verdict.exponent
        low, value, high = (np.nan,) * 3 if e is None else (e.low, e.value, e.high)
        truth = c.values["exponent"]
        return head | {
            "truth": truth, "exponent": value, "exponent_low": low, "exponent_high": high, "intervals": 1,
            "held": int(low <= truth <= high),
        }  # fmt: skip
    results: dict[str, ModelComparison] = {}
    sums = [*all_sums(), term, f"viscous+{term}"]
    verdict = answer(c.signal, damping=sums, restoring=["linear"], comparisons=results).verdict
    comparison = results.get(COMPARED)
    under_exact = candidate_probabilities(comparison, True) if comparison else {}
    truth = set(c.damping.split("+"))
    intervals = {
        q.name: bool(q.low <= c.values[q.name] <= q.high)
        for q in (verdict.coefficients if verdict.damping == c.damping else ())
        if q.name in c.values
    }
    return head | {
        "truth": c.damping, "nats": nats_ahead(comparison, c) if comparison else np.nan,
        "exact": sum(p for candidate, p in under_exact.items() if set(candidate.damping) == truth),
        "first": max((v.probability, v.damping) for v in (verdict, *verdict.rivals))[1],
        "probability": verdict.probability, "decided": int(verdict.decided),
        "intervals": len(intervals), "held": sum(intervals.values()),
        "missed": " ".join(name for name, holds in intervals.items() if not holds),
    }  # fmt: skip


def page(rows: pd.DataFrame) -> str:
    """Return the page on these rows in Markdown."""
    exponents, others = where(rows, term=EXPONENT), where(rows, rows["term"] != EXPONENT)
    named, is_true = others["decided"] == 1, others["first"] == others["truth"]
    has_term = [t in first.split("+") for t, first in zip(others["term"], others["first"], strict=True)]
    others = others.assign(has_term=has_term, is_true=is_true, right=named & is_true, wrong=named & ~is_true)
    distinct = where(others, others["nats"] >= LEAST_NATS)
    cells = []
    for term in TERMS:
        own, clear = where(others, term=term), where(distinct, term=term)
        cells.append([
            f"`{term}`", *(hits_of(total(own, what), len(own)) for what in ("has_term", "is_true", "right", "wrong")),
            hits_of(total(clear, "right"), len(clear)), f"{total(own, 'held')} of {total(own, 'intervals')}",
        ])  # fmt: skip
    count = len(exponents)
    below = [
        share for share in np.arange(0.94, 0.3, -0.01) if count
        and 0.95 - share > 1.96 * np.sqrt(0.95 * 0.05 / count) + 0.84 * np.sqrt(share * (1 - share) / count)
    ]  # fmt: skip
    return f"""# The exponent, and damping terms that are not in the paper

The exponent's 95 % interval contains the truth in {hits_of(total(exponents, "held"), count)} power laws. \
Of {len(others)} records of six further terms, {named.sum()} are named outright, \
{total(others, "right")} of these correctly. Of the {len(distinct)} records whose true sum is distinguishable, \
{total(distinct, "right")} are named outright and correctly.

The records are simulated by SciPy's solver. Their amplitude falls by 60 % or more, with 0.5 to 2 % of noise. The term \
dissipates at least 30 % of the energy, alone or together with viscous damping. It is compared with the paper's seven \
sums, with sequential Monte Carlo. Exponents are between 0.2 and 2.5. The true sum is distinguishable if its best fit \
is {LEAST_NATS:g} nats ahead of that of every sum that lacks one of its terms. The brackets contain 95 % intervals of \
the fractions. {count} exponents distinguish a coverage of 0.95 from one below {max(below, default=0.0):.2f} (5 %) \
with a probability of 0.8.

{table(HEADS, cells)}

laws.csv has every record. `make reports` makes this report again; `ARGS=--full` uses more records.
"""


def main() -> None:
    """Run the command line: answer the records that the table lacks, and write the page."""
    parser = page_options(__doc__)
    parser.add_argument(
        "--seed", type=int, default=86000, help="seed of the first term; each next term adds 1000"
    )
    parser.add_argument("--exponents", type=int, default=60, help="number of power laws")
    parser.add_argument("--each", type=int, default=6, help="number of records of each other term")
    parser.add_argument("--terms", nargs="+", default=[EXPONENT, *TERMS], choices=[EXPONENT, *TERMS])
    given = parser.parse_args()
    todo: dict[str, tuple[str, int]] = {}
    for k, term in enumerate(given.terms):
        first = given.seed + 1000 * k
        count = given.exponents if term == EXPONENT else given.each
        todo |= {f"{term}-{seed}": (term, seed) for seed in range(first, first + count)}
    make_page(given, "laws.csv", COLUMNS, todo, row, page)


if __name__ == "__main__":
    main()
