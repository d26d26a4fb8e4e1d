"""Simulated ring-downs of every kind, and how often the intervals of an envelope's damping hold the truth.

    python -m tests.validation.envelopes RECORDS SEED [KIND]

prints a line a record and counts. KIND: `plain`, one law and one floor, or `harsh` (by default): a law that deviates, a
gain that drifts, a floor that wanders and is partly slow, a drive that drops or stays on, few readings.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np

from bayesdamp.interface.envelopes import analyse
from bayesdamp.physics.amplitude.laws import rate
from bayesdamp.records.envelope.record import made_record
from bayesdamp.verdict.envelope import EnvelopeAnswer
from tests.envelope.ringdowns import NEPER, Ringdown, Simulated, simulate

CASES = ("viscous", "coulomb", "quadratic", "viscous+coulomb", "viscous+quadratic")


def drawn(kind: str, rng: np.random.Generator) -> Ringdown:
    """A ring-down that takes some 20 to 60 s, falls by 20 to 50 dB to its floor, and is read 100 to 4,000 times."""
    took, fall = float(rng.uniform(20, 60)), float(rng.uniform(20, 50))
    terms = CASES[rng.integers(len(CASES))].split("+")
    fall = min(fall, 30.0) if terms == ["quadratic"] else fall
    share = 1.0 if len(terms) == 1 else float(rng.uniform(0.3, 0.7))
    mean = fall / NEPER / took
    # Of terms that grow or fall with the amplitude, their share at half of the fall.
    middle = np.exp(-0.5 * fall / NEPER)
    size = {"viscous": 1.0, "coulomb": middle, "quadratic": 1 / middle}
    rates = {t: mean * part * size[t] for t, part in zip(terms, (share, 1 - share))}
    step = took / float(np.exp(rng.uniform(np.log(100), np.log(4000))))
    scatter = float(np.exp(rng.uniform(np.log(0.01), np.log(0.1))))
    plain = {
        "rates": rates, "fall": fall, "step": step, "before": 0.3 * took, "behind": 0.5 * took, "scatter": scatter,
        "scatter_time": float(rng.uniform(2 * step, 0.02 * took + 2 * step)),
        "floor_time": float(rng.uniform(step, 0.01 * took + step)), "slow_share": 0.0,
    }  # fmt: skip
    if kind == "plain":
        return Ringdown(**plain)
    harsh = {
        "deviation": float(rng.choice([0.0, 0.01, 0.03, 0.06])),
        "deviation_length": float(rng.choice([0.1, 0.3, 1.0])),
        "drift": float(rng.choice([0.0, 0.1])),
        "slow_share": float(rng.uniform(0, 1)),
        "wander": float(rng.choice([0.0, 1.0])),
        "constant": float(rng.choice([0.0, 0.5])),
        "drop": float(rng.choice([0.0, 4.0, 10.0])),
        "hold": float(rng.uniform(0.1, 1.0)),
    }
    return Ringdown(**{**plain, **harsh})


@dataclass(frozen=True)
class Held:
    """Standardised errors, and whether intervals hold the truth: of the rate over the first half of the fall, of which
    Q is made (as the law has it), and of those at three amplitudes (over a tenth of the fall, deviations included)."""

    z: tuple[float, ...]
    inside: tuple[bool, ...]


def held(made: Ringdown, truth: Simulated, answer: EnvelopeAnswer) -> Held:
    assert answer.curve is not None
    known = np.isfinite(truth.x)
    x, t = truth.x[known], truth.t[known]
    first, last = ((answer.curve.fit[i] - made.top) / NEPER for i in (0, -1))
    terms = tuple(made.rates)
    grid = np.linspace(first, 0.5 * (first + last), 400)
    slow = 1 / rate(grid, terms, np.array([made.rates[term] for term in terms]))
    pairs = [(answer.verdict.rate, (grid[0] - grid[-1]) / np.trapezoid(slow, -grid))]
    for at in answer.verdict.decay_rate:
        middle = (at.amplitude - made.top) / NEPER
        span = 0.05 * (first - last)
        near = np.clip([middle + span, middle - span], x[-1], x[0])
        # An amplitude above the release's was never passed in free decay: no interval holds its rate.
        true = (
            (near[0] - near[1]) / float(np.diff(np.interp(-near, -x, t))[0]) if near[0] > near[1] else np.nan
        )
        pairs.append((at, true))
    z = tuple(float((e.value - true) / np.hypot(e.sd_noise, e.sd_law)) for e, true in pairs)
    return Held(z, tuple(bool(e.low <= true <= e.high) for e, true in pairs))


def main(records: int, seed: int, kind: str = "harsh") -> None:
    found, refused = [], 0
    for i in range(records):
        rng = np.random.default_rng([seed, i])
        made = drawn(kind, rng)
        truth = simulate(made, rng)
        answer = analyse(made_record(str(i), truth.t, truth.level, "dBm", 1e6))
        result = answer.verdict
        if result.rate is None:
            refused += 1
            print(i, result.sentence, flush=True)
            continue
        one = held(made, truth, answer)
        found.append(one)
        print(
            i, "+".join(made.rates), f"{made.fall:.0f} dB",
            f"deviation {made.deviation:g} length {made.deviation_length:g}",
            f"drift {made.drift:g} slow {made.slow_share:.2f} wander {made.wander:g} constant {made.constant:g}",
            f"drop {made.drop:g} scatter {made.scatter:.3f} n {truth.t.size} ->", result.damping, result.grade,
            np.round(one.z, 2), *one.inside, f"cut {result.window.start - truth.release:.2f}", flush=True,
        )  # fmt: skip
    inside = np.array([h.inside for h in found])
    z = np.array([h.z for h in found])
    print(
        kind, f"seed {seed}: {len(found)} answered, {refused} refused; intervals that hold the rate, and that at the",
        "amplitudes", inside.sum(axis=0), f"{inside.mean():.3f}; median z2", np.round(np.nanmedian(z**2, axis=0), 2),
        flush=True,
    )  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:])
