"""Answer simulated records with damping terms that are not in the paper, and write the page on the results.

`python -m validation.experiments.laws TABLE FOLDER [--seed 87000 --each 6]`. EACH is the number of records of each
term. SEED is the seed of the first record of the first term; the seeds of each next term begin 1000 later.
"""

import math
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from bayesdamp.inference.deviation.model_comparison import ModelComparison
from bayesdamp.interface.answer import answer, compare_models
from bayesdamp.physics.damping import TERMS as DAMPINGS, all_sums
from bayesdamp.types import Signal
from bayesdamp.verdict.types import Verdict
from validation.scoring import (
    COLUMNS,
    groups_of,
    hits_of,
    make_page,
    named,
    page_options,
    row_of,
    score_table,
    terms_of,
)
from validation.truth.drawing import log_uniform
from validation.truth.motion import NoMotionError, solve_motion
from validation.truth.oscillator import Discrepancy, Oscillator
from validation.truth.ratio import harmonic_ratio
from validation.truth.records import NATS, Case

PARAMETERS = ("nats", "intervals", "held")
"""Further columns of the table. `nats`: by how many nats (difference in log likelihood) the true damping sum is ahead
of the best sum that lacks one of its terms. `intervals`: number of true damping parameters with a 95 % interval.
`held`: number of these intervals that contain the truth."""
TERMS = ("cubic", "displacement", "power", "dry_position", "structural", "stribeck")
"""The damping terms that are tested, by their names in bayesdamp."""
LEAST_SHARE, LEAST_FALL = 0.3, 0.6
"""Smallest fraction of the energy loss that the tested term must cause, and smallest fraction by which the amplitude
must fall. A record with less is drawn again."""


def truth_of(
    term: str, rng: np.random.Generator, size: float, speed: float
) -> tuple[Discrepancy, dict[str, float]]:
    """Draw the parameters of a damping term, except its coefficient, for motions of this amplitude and peak velocity.

    term: a name of `TERMS`. size, speed: amplitude (rad) and peak velocity (rad/s). Return its force per unit of the
    coefficient, and the values of its other parameters.
    """
    match term:
        case "cubic":
            return Discrepancy(term, lambda x, v, turn: v**3), {}
        case "displacement":
            return Discrepancy(term, lambda x, v, turn: x * x * v), {}
        case "structural":
            return Discrepancy(term, lambda x, v, turn: abs(x) * turn), {}
        case "stribeck":
            excess, slow = rng.uniform(0.5, 1.5), rng.uniform(0.1, 0.5) * speed
            return Discrepancy(
                term, lambda x, v, turn: (1 + excess * math.exp(-((v / slow) ** 2))) * turn, lambda x: 1 + excess
            ), {"static_excess": excess, "stribeck_velocity": slow}  # fmt: skip
        case "dry_position":
            slope, bend = rng.uniform(-0.4, 0.4), rng.choice([rng.uniform(-0.6, -0.3), rng.uniform(0.5, 2.0)])

            def friction(x: float) -> float:
                return 1 + slope * x / size + bend * (x / size) ** 2

            unit = Discrepancy(term, lambda x, v, turn: friction(x) * turn, friction)
            return unit, {"friction_slope": slope, "friction_curvature": bend}
        case _:
            p = rng.choice([0.5, 1.5, 2.5]) + rng.uniform(-0.2, 0.2)
            return Discrepancy(term, lambda x, v, turn: speed * abs(v / speed) ** p * turn), {"exponent": p}


def case(term: str, seed: int) -> Case:
    """Simulate a record whose damping is a given term (a name of `TERMS`), alone or with viscous damping.

    The amplitude falls by 60 to 88 % within 15 to 40 cycles, with noise of 0.5 to 2 % of the amplitude. A draw is
    repeated if the motion sticks, the amplitude falls less, or the term causes less than 30 % of the energy loss.
    `parameters` of the result contains the damping parameters, `shares` only the fraction of the energy loss that the
    term causes.
    """
    rng = np.random.default_rng(seed)
    while True:
        with suppress(NoMotionError):
            return _simulate(term, rng, f"{term}-{seed}")


def _simulate(term: str, rng: np.random.Generator, name: str) -> Case:
    """Draw and simulate one record of a damping term, alone or with viscous damping.

    Raises NoMotionError if the motion sticks, the amplitude falls by less than `LEAST_FALL`, or the term causes less
    than `LEAST_SHARE` of the energy loss.
    """
    size, frequency = log_uniform(rng, 0.02, 0.4), float(rng.uniform(1.5, 12.0))
    speed, cycles, left = size * frequency, float(rng.uniform(15, 40)), float(rng.uniform(0.12, 0.4))
    unit, further = truth_of(term, rng, size, speed)
    alone = term == "power" or rng.random() < 0.5
    share = 1.0 if alone else float(rng.uniform(0.3, 0.9))

    def ratio(a: float) -> float:
        """Return the equivalent damping ratio of the term at an amplitude a (rad), per unit of its coefficient."""
        return harmonic_ratio(lambda x, v: unit.damping(x, v, math.copysign(1.0, v)), a, frequency)

    # Damping ratio of the viscous damping, per unit of the coefficient of the term.
    rate = (1 - share) / share * ratio(size * math.sqrt(left))
    grid = np.geomspace(size, left * size, 60)
    # The amplitude A decreases with the number n of cycles as dA/dn = −2π ratio(A) A.
    each = np.array([1 / (2 * np.pi * (ratio(a) + rate)) for a in grid])
    coefficient = float(np.sum(0.5 * (each[1:] + each[:-1]) * -np.diff(np.log(grid)))) / cycles
    zeta = coefficient * rate * frequency
    viscous = {} if alone else {"viscous": zeta}
    odd = replace(
        unit,
        damping=lambda x, v, turn: coefficient * unit.damping(x, v, turn),
        static_friction=lambda x: coefficient * unit.static_friction(x),
    )
    spring = {"stiffness": frequency**2, "rest_angle": float(rng.uniform(-0.1, 0.1)) * size}
    oscillator = Oscillator("linear", spring, viscous, discrepancy=odd)
    times = np.linspace(0, cycles * 2 * np.pi / frequency, int(cycles * rng.uniform(30, 60)))
    motion = solve_motion(oscillator, size, frequency, float(times[-1]) + 1e-9)
    y, v = motion.at(times)
    if np.abs(motion.turns[-1]) > (1 - LEAST_FALL) * size:
        raise NoMotionError("the amplitude falls too little")
    x = y - oscillator.equilibrium()
    own = np.array([unit.damping(a, b, math.copysign(1.0, b)) * b for a, b in zip(x, v, strict=True)])
    part = coefficient * own.sum() / (coefficient * own.sum() + np.sum(2 * zeta * v * v))
    if part < LEAST_SHARE:
        raise NoMotionError("the term has too small a share of the loss")
    noise = float(rng.uniform(0.005, 0.02)) * size
    values = {DAMPINGS.get(term).parameter: coefficient, **further} | ({} if alone else {"zeta": zeta})
    signal = Signal(times, y + noise * rng.standard_normal(times.size))
    damping = term if alone else f"viscous+{term}"
    return Case(name, term, signal, damping, parameters=values, noise_sd=noise, shares={term: float(part)})


def nats_ahead(comparison: ModelComparison, c: Case) -> float:
    """Return by how many nats the true damping sum fits better than the best sum that lacks one of its terms.

    comparison: the comparison of all sums on the record. c: the record and its truth. The result is the difference of
    the log likelihoods of the best fits under exact laws with the true noise. It is infinite if no sum without a true
    term was fitted (because none was expected to fit), and NaN if the true sum was not fitted.
    """
    true = terms_of(c.damping)
    squares = {frozenset(r.candidate.damping): r.fit.squares for r in comparison.results}
    rival = min((value for terms, value in squares.items() if not true <= terms), default=math.inf)
    return (rival - squares.get(true, math.nan)) / (2 * c.noise_sd**2 / comparison.data.thinned)


def row(term: str, seed: int) -> dict[str, Any]:
    """Simulate a record of a term and answer it; return the row of the table.

    These damping sums are compared: the seven of the paper, the term alone, and the term with viscous damping.
    """
    c = case(term, seed)
    further: dict[str, float] = {"intervals": 0, "held": 0}

    def answer_record(signal: Signal, _: tuple[float, ...]) -> Verdict:
        sums = [*all_sums(), term, f"viscous+{term}"]
        comparison = compare_models(signal, damping=sums, restoring=["linear"])
        verdict = answer(signal, comparison).verdict
        inside = [
            q.low <= c.parameters[q.name] <= q.high
            for q in (verdict.coefficients if verdict.damping == c.damping else ())
            if q.name in c.parameters
        ]
        further.update(intervals=len(inside), held=sum(inside))
        if isinstance(comparison, ModelComparison):
            further.update(nats=nats_ahead(comparison, c))
        return verdict

    return row_of(c, answer_record) | further


def page(rows: pd.DataFrame) -> str:
    """Return the page on the results in Markdown, from the rows of the table (one for each record)."""
    more = {
        "named correctly, of the distinguishable": _of_distinguishable,
        "intervals of parameters with the truth": lambda part: (
            f"{part['held'].sum():.0f} of {part['intervals'].sum():.0f}"
        ),
    }
    scores = (
        "records", "true sum most probable", "named outright, correctly", "named outright, wrongly", "CPU seconds",
    )  # fmt: skip
    return f"""# Damping terms that are not in the paper

Of {len(rows)} records of six further terms, {named(rows)} are named outright, {named(rows, right=1)} of these \
correctly. Of the records whose true sum is distinguishable, {_of_distinguishable(rows)} are named outright and \
correctly.

The records are simulated by SciPy's solver. Their amplitude falls by 60 % or more, with 0.5 to 2 % of noise. The term \
dissipates at least 30 % of the energy, alone or together with viscous damping. It is compared with the paper's seven \
sums, with sequential Monte Carlo. The true sum is distinguishable if its best fit \
is {NATS:g} nats ahead of that of every sum that lacks one of its terms. The brackets contain 95 % intervals of \
the fractions.

{score_table({f"`{term}`": part for term, part in groups_of(rows, order=TERMS).items()}, *scores, more=more)}

laws.csv has every record. `make reports` makes this report again.
"""


def _of_distinguishable(rows: pd.DataFrame) -> str:
    """Return, as text, how many of the records whose true sum is distinguishable are named outright and correctly."""
    clear = rows.loc[rows["nats"] >= NATS]
    return hits_of(named(clear, right=1), len(clear))


def main() -> None:
    """Run the command line: answer the records that the table lacks, and write the page."""
    given = page_options(__doc__, seed=87000, each=6).parse_args()
    todo: dict[str, tuple[str, int]] = {}
    for k, term in enumerate(TERMS):
        first = given.seed + 1000 * k
        todo |= {f"{term}-{seed}/bayesdamp": (term, seed) for seed in range(first, first + given.each)}
    make_page(given, todo, row, page, (*COLUMNS, *PARAMETERS), "laws.csv")


if __name__ == "__main__":
    main()
