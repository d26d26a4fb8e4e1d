"""Answer simulated specimens of several records, and count how often the right damping is named.

    python -m validation.experiments.specimens exact|deviating SPECIMENS SEED [RECORDS SPREAD]

The dampings are viscous + Coulomb, viscous + quadratic, Coulomb and viscous in turn. The coefficients of a record are
those of the specimen times a factor of the record, whose logarithm has the standard deviation SPREAD (by default 4
records and 0.03). `deviating`: the force is up to 10 % larger or smaller, as a function of the logarithm of the
amplitude, the same for all records. SciPy's eighth-order solver computes the motions; the restoring law is linear, and
the answers know it. The control is the product of the records' own evidences, as if each had its own coefficients.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.integrate import solve_ivp

from bayesdamp.interface.answer import answer
from bayesdamp.priors import odds
from bayesdamp.types import Signal
from bayesdamp.verdict.specimen import RecordAnswer, specimen
from bayesdamp.verdict.thresholds import DECIDED
from bayesdamp.verdict.types import Verdict
from validation.truth.rivals import loss_rate

OMEGA, CYCLES, NOISES = 4.5, 12, (0.004, 0.06)
"""rad/s; cycles; least and most noise in rad, log-uniform between them for each specimen."""
DAMPINGS = (
    {"viscous": 0.1, "coulomb": 0.25},
    {"viscous": 0.1, "quadratic": 0.08},
    {"coulomb": 0.5},
    {"viscous": 0.1},
)
"""Coefficients ζ (1/s), μ_c (rad/s²), μ_q (1/rad)."""


def simulate(
    rng: np.random.Generator, damping: dict[str, float], deviation: float, noise: float, name: str
) -> Signal:
    """Simulate 12 cycles of 25 samples, from 0.9 to 1.1 rad."""
    start, stop = rng.uniform(0.9, 1.1), CYCLES * 2 * np.pi / OMEGA
    times = np.linspace(0, stop, 25 * CYCLES)
    zeta, dry, drag = (damping.get(n, 0.0) for n in ("viscous", "coulomb", "quadratic"))

    def slope(_: float, s: np.ndarray) -> tuple[float, float]:
        amplitude = np.hypot(s[0], s[1] / OMEGA)
        off = 1 + deviation * np.sin(3 * np.log(max(amplitude, 1e-3) / 0.1))
        force = 2 * zeta * s[1] + dry * np.tanh(s[1] / 0.02) + drag * abs(s[1]) * s[1]
        return s[1], -(OMEGA**2) * s[0] - off * force

    y = solve_ivp(slope, (0, stop), (start, 0.0), "DOP853", times, rtol=1e-9, atol=1e-11).y[0]
    return Signal(times, y + noise * rng.standard_normal(times.size), name=name)


def answers(
    rng: np.random.Generator, damping: dict[str, float], deviation: float, records: int, spread: float
) -> list[RecordAnswer]:
    """Answer each record of a specimen by itself, from linear models."""
    results, noise = [], float(np.exp(rng.uniform(*np.log(NOISES))))
    for k in range(records):
        factor = float(np.exp(spread * rng.standard_normal()))
        own = {n: v * factor for n, v in damping.items()}
        signal = simulate(rng, own, deviation, noise, f"r{k}")
        law = "law" if deviation else "none"
        result = answer(signal, restoring=("linear",), sample=False, deviation=law, repeated=True)
        results += [result.of_specimen()] if result.arrays else []
    return results


def outcome(named: str, decided: bool, truth: set[str]) -> str:
    """Return whether the truth is named, another damping is, or none."""
    if not decided:
        return "open"
    return "right" if set(named.split("+")) == truth else "wrong"


def product(records: list[RecordAnswer]) -> tuple[str, float]:
    """Return the most probable sum and its probability from the product of the records' evidences."""
    logs = {
        model: sum(r.comparison.log_evidence.get(model, -60.0) for r in records)
        + float(np.log(odds(model[0].split("+"))))
        for model in records[0].comparison.log_evidence
    }
    top = max(logs, key=lambda m: logs[m])
    return top[0], float(1 / sum(np.exp(v - logs[top]) for v in logs.values()))


def true_ratio(damping: dict[str, float], amplitude: float) -> float:
    """Return the equivalent viscous damping ratio at an amplitude in rad."""
    return float(sum(value * loss_rate(name, amplitude, OMEGA) for name, value in damping.items()))


def main(kind: str, specimens: int, seed: int, records: int = 4, spread: float = 0.03) -> None:
    """Answer several specimens, and print the counts."""
    counts: dict[str, list[str]] = {"joined": [], "product": []}
    inside, widths, alone, together = 0, [], [], []
    for i in range(specimens):
        damping = DAMPINGS[i % len(DAMPINGS)]
        deviation = 0.1 if kind == "deviating" else 0.0
        results = answers(np.random.default_rng([seed, i]), damping, deviation, records, spread)
        verdict = specimen("specimen", results, sensor=0.0)
        truth = set(damping)
        counts["joined"].append(outcome(verdict.damping, verdict.decided, truth))
        named, p = product(results)
        counts["product"].append(outcome(named, p >= DECIDED, truth))
        r = verdict.damping_ratio[1]
        inside += r.low <= true_ratio(damping, r.amplitude) <= r.high
        widths.append((r.high - r.low) / r.value)
        alone.append(float(np.mean([_probability(a.verdict, truth) for a in results])))
        together.append(_probability(verdict, truth))
        print(i, "+".join(damping), counts["joined"][-1], verdict.damping, f"{together[-1]:.3f}", flush=True)
    for name, each in counts.items():
        shown = {result: each.count(result) for result in ("right", "wrong", "open")}
        print(f"{kind}, seed {seed}, {records} records, spread {spread:g}, {name}: {shown}", flush=True)
    print(
        f"probability of the truth {np.mean(together):.3f} (records alone {np.mean(alone):.3f}); the ratio's interval "
        f"holds {inside} of {specimens}, its median width {np.median(widths):.3f}",
        flush=True,
    )


def _probability(verdict: Verdict, truth: set[str]) -> float:
    every = {verdict.damping: verdict.probability, **{r.damping: r.probability for r in verdict.rivals}}
    return sum(p for name, p in every.items() if set(name.split("+")) == truth)


if __name__ == "__main__":
    numbers = sys.argv[2:]
    main(sys.argv[1], *map(int, numbers[:3]), *map(float, numbers[3:]))
