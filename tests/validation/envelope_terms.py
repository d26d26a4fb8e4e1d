"""Terms beside the paper's in envelopes of whole oscillators: how often each is named, and its numbers held.

    python -m tests.validation.envelope_terms TERM RECORDS [SEED]

TERM: cubic, power, stribeck or dry_position. Sizes vary by three, noise is 0.3, 1 or 2 %; a record whose amplitude
falls by less than 60 % is left out. What a record can tell is how far the truth is ahead of the best rival, in nats of
the greatest likelihoods under exact laws with the noise known: from TOLD on one can name it.
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
from bayesdamp.physics.amplitude.loss import Scale
from bayesdamp.verdict import Verdict
from tests.envelope.oscillations import FLOOR, SHARP, START, Force, envelope, turning_points

SUMS = (
    ("viscous",), ("coulomb",), ("quadratic",), ("viscous", "coulomb"), ("viscous", "quadratic"),
    ("coulomb", "quadratic"), ("cubic",), ("power",), ("stribeck",), ("dry_position",),
)  # fmt: skip
SHARE = 0.4
"""Of the amplitude at the start what has to be left at most."""
TOLD = 12.0
"""Nats from which on the truth can be named, as for oscillations."""
WIDER = {"cubic": ("power",)}
"""Laws of which a term is one: no rivals by likelihood."""


def drawn(term: str, size: float, rng: np.random.Generator) -> tuple[Force, dict[str, float]]:
    """A force, and the true numbers, near the middle of what terms' priors allow."""
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
    """Nats by which a term describes ln of amplitudes (n,) at times t (s) with sd (n,) better than the best other sum
    does, both at their greatest likelihoods, and that sum."""
    decay = Blocks(t - t[0], x - x.mean(), float(t[-1] - t[0]), float((x[0] - x[-1]) / (t[-1] - t[0])))
    start, low = decay.ends[0], float(decay.x.min())
    weight = np.diag(1.0 / sd)
    every = sums_on([one for one in SUMS if one[0] not in WIDER.get(term, ())], Scale(), start, low)
    squares = {one.name: _least_squares(decay, one, weight) for one in every}
    truth = squares.pop(term)
    rival = min(squares, key=squares.__getitem__)
    return 0.5 * (squares[rival] - truth), rival


def _least_squares(decay: Blocks, one: Sum, weight: np.ndarray) -> float:
    def at(scores: Sequence[float]) -> float:
        return fit_rates(decay, one.law(tuple(float(z) for z in scores)), weight).squares

    if not one.count:
        return at(())
    begin = explore(lambda z: -0.5 * at(z), one.count, FIRST_ROUNDS).best
    return float(minimize(at, begin, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 0.02}).fun)


@dataclass
class Count:
    """Of records of a term: how many, named at all, named outright, another named outright; intervals that held."""

    records: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    held: dict[str, list[bool]] = field(default_factory=dict)

    def add(self, term: str, found: Verdict, inside: dict[str, bool]) -> None:
        """Of one more record."""
        self.records += 1
        self.outcomes["named"] += found.damping == term
        self.outcomes["outright"] += found.damping == term and found.decided
        self.outcomes["another outright"] += found.damping != term and found.decided
        for name, value in inside.items():
            self.held.setdefault(name, []).append(value)

    def __str__(self) -> str:
        shares = ", ".join(f"{name} {sum(each)} of {len(each)}" for name, each in self.held.items())
        said = ", ".join(f"{what} {count}" for what, count in self.outcomes.items())
        return f"{self.records} records: {said}; held {shares or 'none'}"


def main(term: str, records: int, seed: int = 1) -> None:
    whole, told = Count(), Count()
    for k in range(records):
        rng = np.random.default_rng([seed, k])
        size = float(np.exp(rng.uniform(np.log(0.5), np.log(1.5))))
        force, truths = drawn(term, size, rng)
        t, amplitudes = turning_points(force)
        if amplitudes[-1] > SHARE * START:
            continue
        noise = float(rng.choice([0.003, 0.01, 0.02]))
        record = envelope(force, [seed, k], noise=noise)
        sd = np.hypot(noise, FLOOR * START / np.sqrt(2) / amplitudes)
        nats, rival = lead(term, t, record.level * np.log(10) / 20, sd)
        found = analyse(record, sums=SUMS).verdict
        inside = {
            c.name: c.low <= truths[c.name] <= c.high
            for c in (found.coefficients if found.damping == term else ())
            if c.name in truths
        }
        for count in (whole, told) if nats >= TOLD else (whole,):
            count.add(term, found, inside)
        print(
            k,
            truths,
            f"noise {noise:g}: {nats:.1f} nats before {rival} -> {found.damping} {found.probability:.2f}",
            f"{found.grade} {'outright' if found.decided else 'not decided'}",
            inside,
            flush=True,
        )
    print(f"{term}, seed {seed}: {whole}\nof these {TOLD:g} nats or more ahead: {told}")


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
