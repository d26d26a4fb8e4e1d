"""Simulated specimens of four records, and which damping the verdict on each names: sizes of the deviations shared by
its records, as it has them, and, as the control, inferred for each record anew.

    python -m tests.validation.specimens exact|deviating SPECIMENS SEED

The dampings are viscous + Coulomb, viscous + quadratic, Coulomb and viscous in turn; coefficients differ from record to
record by 3 %. `deviating`: the force is by up to 10 % larger or smaller with the logarithm of the amplitude, alike in
all records. Motions are SciPy's, of eighth order; the restoring law is linear, and known to be.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
from scipy.integrate import solve_ivp

from bayesdamp.pipeline.answer import answer
from bayesdamp.types import Signal
from bayesdamp.verdict.specimen import Answered, specimen
from bayesdamp.verdict.types import Verdict

OMEGA, CYCLES, NOISE, RECORDS, APART = 4.5, 12, 0.005, 4, 0.03
DAMPINGS = (
    {"viscous": 0.1, "coulomb": 0.25},
    {"viscous": 0.1, "quadratic": 0.08},
    {"coulomb": 0.5},
    {"viscous": 0.1},
)
"""Coefficients ζ (1/s), μ_c (rad/s²), μ_q (1/rad)."""


def simulate(rng: np.random.Generator, damping: dict[str, float], deviation: float, name: str) -> Signal:
    """12 cycles from 0.9 to 1.1 rad, 25 samples each."""
    start, stop = rng.uniform(0.9, 1.1), CYCLES * 2 * np.pi / OMEGA
    times = np.linspace(0, stop, 25 * CYCLES)
    zeta, dry, drag = (damping.get(n, 0.0) for n in ("viscous", "coulomb", "quadratic"))

    def slope(_: float, s: np.ndarray) -> tuple[float, float]:
        amplitude = np.hypot(s[0], s[1] / OMEGA)
        off = 1 + deviation * np.sin(3 * np.log(max(amplitude, 1e-3) / 0.1))
        force = 2 * zeta * s[1] + dry * np.tanh(s[1] / 0.02) + drag * abs(s[1]) * s[1]
        return s[1], -(OMEGA**2) * s[0] - off * force

    y = solve_ivp(slope, (0, stop), (start, 0.0), "DOP853", times, rtol=1e-9, atol=1e-11).y[0]
    return Signal(times, y + NOISE * rng.standard_normal(times.size), name=name)


def answers(rng: np.random.Generator, damping: dict[str, float], deviation: float) -> list[Answered]:
    """Of each record by itself, from linear models."""
    found = []
    for k in range(RECORDS):
        own = {n: v * rng.normal(1, APART) for n, v in damping.items()}
        one = answer(simulate(rng, own, deviation, f"r{k}"), restoring=("linear",), sample=False)
        found += [one.of_specimen()] if one.arrays else []
    return found


def said(verdict: Verdict, truth: set[str]) -> str:
    """Whether the truth is named, another damping is, or none."""
    if not verdict.decided:
        return "open"
    return "right" if set(verdict.damping.split("+")) == truth else "wrong"


def main(kind: str, specimens: int, seed: int) -> None:
    counts: dict[str, list[str]] = {"shared": [], "each": []}
    for i in range(specimens):
        damping = DAMPINGS[i % len(DAMPINGS)]
        found = answers(np.random.default_rng([seed, i]), damping, 0.1 if kind == "deviating" else 0.0)
        both = {"shared": found, "each": [replace(one, sizes={}) for one in found]}
        for name, records in both.items():
            verdict = specimen(name, records)
            counts[name].append(said(verdict, set(damping)))
            probability = f"{verdict.probability:.3f}"
            print(i, "+".join(damping), name, counts[name][-1], verdict.damping, probability, flush=True)
    for name, each in counts.items():
        shown = {what: each.count(what) for what in ("right", "wrong", "open")}
        print(f"{kind}, seed {seed}, sizes {name}: {shown}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
