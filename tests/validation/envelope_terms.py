"""Terms beside the paper's in envelopes of whole oscillators: how often each is named, and its numbers held.

    python -m tests.validation.envelope_terms TERM RECORDS [SEED]

TERM: cubic, power, stribeck or dry_position. Sizes vary by three, noise is 0.3, 1 or 2 %; a record whose amplitude
falls by less than 60 % is left out.
"""

from __future__ import annotations

import sys

import numpy as np

from bayesdamp.envelope import analyse
from tests.envelope.oscillations import SHARP, START, Force, envelope, turning_points

SUMS = (
    ("viscous",), ("coulomb",), ("quadratic",), ("viscous", "coulomb"), ("viscous", "quadratic"),
    ("coulomb", "quadratic"), ("cubic",), ("power",), ("stribeck",), ("dry_position",),
)  # fmt: skip
SHARE = 0.4
"""Of the amplitude at the start what has to be left at most."""


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


def main(term: str, records: int, seed: int = 1) -> None:
    named = outright = others = whole = 0
    held: dict[str, list[bool]] = {}
    for k in range(records):
        rng = np.random.default_rng([seed, k])
        size = float(np.exp(rng.uniform(np.log(0.5), np.log(1.5))))
        force, truths = drawn(term, size, rng)
        amplitudes = turning_points(force)[1]
        if amplitudes[-1] > SHARE * START:
            continue
        whole += 1
        noise = float(rng.choice([0.003, 0.01, 0.02]))
        found = analyse(envelope(force, [seed, k], noise=noise), sums=SUMS)
        named += found.damping == term
        outright += found.damping == term and found.decided
        others += found.damping != term and found.decided
        inside = {}
        for c in found.coefficients if found.damping == term else ():
            if c.name in truths:
                inside[c.name] = c.estimate.low <= truths[c.name] <= c.estimate.high
                held.setdefault(c.name, []).append(inside[c.name])
        print(
            k,
            truths,
            f"noise {noise:g} -> {found.damping} {found.probability:.2f} {found.grade}",
            inside,
            flush=True,
        )
    shares = {name: f"{sum(each)} of {len(each)}" for name, each in held.items()}
    print(
        f"{term}: {whole} records, named {named}, outright {outright}, another outright {others}; held",
        shares,
    )


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
