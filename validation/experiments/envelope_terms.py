"""Answer envelopes of oscillators with other damping terms than the paper's, and count how often each term is named.

    python -m validation.experiments.envelope_terms TERM RECORDS [SEED]

TERM: cubic, power, stribeck or dry_position. Sizes vary by a factor of three, noise is 0.3, 1 or 2 %; records whose
amplitude falls by less than 60 % are left out. A term can be named if its lead over the best rival is at least
LEAST_NATS, from the greatest likelihoods under exact laws with known noise.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize

from bayesdamp.inference.envelope.candidates import Blocks, fit_rates
from bayesdamp.inference.envelope.sums import FIRST_ROUNDS, Sum, explore, sums_on
from bayesdamp.interface.envelopes import analyse
from bayesdamp.physics.amplitude import Scale
from bayesdamp.records.envelope.record import made_record
from bayesdamp.verdict import Verdict
from validation.experiments.laws import LEAST_NATS
from validation.truth.turning_points import (
    FLOOR,
    FREQUENCY,
    SHARP,
    START,
    Force,
    readings,
    turning_points,
)

SUMS = (
    ("viscous",), ("coulomb",), ("quadratic",), ("viscous", "coulomb"), ("viscous", "quadratic"),
    ("coulomb", "quadratic"), ("cubic",), ("power",), ("stribeck",), ("dry_position",),
)  # fmt: skip
SHARE = 0.4
"""Largest amplitude at the end of a record, relative to that at the start."""
WIDER = {"cubic": ("power",)}
"""Terms that contain a term, and are therefore not its rivals."""


def drawn(term: str, size: float, rng: np.random.Generator) -> tuple[Force, dict[str, float]]:
    """Draw a damping force and its true parameters, near the middle of their priors."""
    if term == "cubic":
        return lambda x, v: 0.1 * size * v**3, {"mu_3": 0.1 * size}
    if term == "power":
        p = float(rng.choice([0.5, 1.5, 2.5]))
        return lambda x, v: 0.1 * size * abs(v) ** p * np.sign(v), {"exponent": p}
    if term == "stribeck":
        slow = float(rng.uniform(0.6, 1.8))
        return (
            lambda x, v: 0.09 * size * (1 + np.exp(-((v / slow) ** 2))) * np.tanh(v / SHARP),
            {"mu_k": 0.09 * size, "static_excess": 1.0, "stribeck_velocity": slow},
        )
    bend = float(rng.choice([-0.6, 1.5]))
    return (
        lambda x, v: 0.11 * size * max(1 + bend * (x / START) ** 2, 0.0) * np.tanh(v / SHARP),
        {"mu_p": 0.11 * size, "friction_curvature": bend},
    )


def lead(term: str, t: np.ndarray, x: np.ndarray, sd: np.ndarray) -> tuple[float, str]:
    """Return the lead of a term over the best other sum in nats, both at their greatest likelihoods, and that sum.

    Parameters
    ----------
    term
        The term.
    t, x, sd
        Times in s, logarithms of amplitudes and their standard deviations, shape (n,).
    """
    decay = Blocks(t - t[0], x - x.mean(), float(t[-1] - t[0]), float((x[0] - x[-1]) / (t[-1] - t[0])))
    start, low = decay.ends[0], float(decay.x.min())
    weight = np.diag(1.0 / sd)
    candidates = [s for s in SUMS if s[0] not in WIDER.get(term, ())]
    squares = {s.name: _least_squares(decay, s, weight) for s in sums_on(candidates, Scale(), start, low)}
    truth = squares.pop(term)
    rival = min(squares, key=squares.__getitem__)
    return 0.5 * (squares[rival] - truth), rival


def _least_squares(decay: Blocks, damping: Sum, weight: np.ndarray) -> float:
    def at(scores: Sequence[float]) -> float:
        return fit_rates(decay, damping.law(tuple(float(z) for z in scores)), weight).squares

    if not damping.count:
        return at(())
    begin = explore(lambda z: -0.5 * at(z), damping.count, FIRST_ROUNDS).best
    return float(minimize(at, begin, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 0.02}).fun)


@dataclass
class Count:
    """Counts over the records of a term.

    Attributes
    ----------
    records : int
        Number of records.
    outcomes : Counter
        How often the term is named at all, and the term or another sum without reservation.
    inside : dict
        Whether the interval of each parameter contains the truth.
    """

    records: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    inside: dict[str, list[bool]] = field(default_factory=dict)

    def add(self, term: str, verdict: Verdict, inside: dict[str, bool]) -> None:
        """Count one more record."""
        self.records += 1
        self.outcomes["named"] += verdict.damping == term
        self.outcomes["outright"] += verdict.damping == term and verdict.decided
        self.outcomes["another outright"] += verdict.damping != term and verdict.decided
        for name, value in inside.items():
            self.inside.setdefault(name, []).append(value)

    def __str__(self) -> str:
        shares = ", ".join(f"{name} {sum(each)} of {len(each)}" for name, each in self.inside.items())
        outcomes = ", ".join(f"{what} {count}" for what, count in self.outcomes.items())
        return f"{self.records} records: {outcomes}; held {shares or 'none'}"


def main(term: str, records: int, seed: int = 1) -> None:
    """Answer several records of a term, and print the counts."""
    every, clear = Count(), Count()
    for k in range(records):
        rng = np.random.default_rng([seed, k])
        size = float(np.exp(rng.uniform(np.log(0.5), np.log(1.5))))
        force, truths = drawn(term, size, rng)
        t, amplitudes = turning_points(force)
        if amplitudes[-1] > SHARE * START:
            continue
        noise = float(rng.choice([0.003, 0.01, 0.02]))
        record = made_record("x", *readings(force, [seed, k], noise), "rad", FREQUENCY)
        sd = np.hypot(noise, FLOOR * START / np.sqrt(2) / amplitudes)
        nats, rival = lead(term, t, record.level * np.log(10) / 20, sd)
        verdict = analyse(record, sums=SUMS).verdict
        inside = {
            c.name: c.low <= truths[c.name] <= c.high
            for c in (verdict.coefficients if verdict.damping == term else ())
            if c.name in truths
        }
        for count in (every, clear) if nats >= LEAST_NATS else (every,):
            count.add(term, verdict, inside)
        print(
            k, truths, f"noise {noise:g}: {nats:.1f} nats before {rival} -> {verdict.damping}",
            f"{verdict.probability:.2f} {verdict.grade} {'outright' if verdict.decided else 'not decided'}", inside,
            flush=True,
        )  # fmt: skip
    print(f"{term}, seed {seed}: {every}\nof these {LEAST_NATS:g} nats or more ahead: {clear}")


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
