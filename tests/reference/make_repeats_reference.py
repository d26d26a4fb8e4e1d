"""Make the reference evidence of three runs of one damper by quadrature; nothing of the package is used.

    python -m tests.reference.make_repeats_reference      # three minutes; writes repeats.json beside this file

The oscillator, its motion in closed form and the prior of its damping ratios are those of make_light_reference.py, with
damping a hundred times larger. The three runs have the same two coefficients times a factor of their own, whose log
is normal with an unknown spread (half-normal prior, scale 0.1). Everything else is known. Integration is by the
trapezoidal rule over the direction of the two ratios, the logarithm of their length, the factors, and the spread.
"""

from __future__ import annotations

import json
import math
import platform
from pathlib import Path

import numpy as np
import scipy
from scipy.special import logsumexp

from tests.reference.make_light_reference import AMPLITUDE, OMEGA, log_prior, motion

RATIOS = (1.0e-2, 0.5e-2)
FACTORS = (0.96, 1.01, 1.05)
NOISE, CYCLES, SAMPLES, SEED = 0.012, 12, 160, 22
SPREAD = 0.1
SUMS = (("viscous",), ("coulomb",), ("viscous", "coulomb"))
PER_RATIO = {"zeta": OMEGA, "mu_c": 0.5 * math.pi * OMEGA**2 * AMPLITUDE}
LENGTHS = np.linspace(math.log(2e-3), math.log(6e-2), 1201)
"""Logarithms of the length of the vector of ratios."""
ANGLES, SPREADS = 161, np.linspace(0.0, 0.5, 101)


def runs() -> tuple[np.ndarray, list[np.ndarray]]:
    rng = np.random.default_rng(SEED)
    t = np.linspace(0.0, 2 * math.pi * CYCLES / OMEGA, SAMPLES)
    made = []
    for factor in FACTORS:
        values = {n: factor * p * r for (n, p), r in zip(PER_RATIO.items(), RATIOS)}
        made.append(motion(t, **values) + NOISE * rng.standard_normal(SAMPLES))
    return t, made


def log_likelihoods(t: np.ndarray, y: list[np.ndarray], direction: dict[str, float]) -> np.ndarray:
    """Of each run at each length along a direction, (3, n)."""
    motions = np.array([
        motion(t, **{n: p * direction[n] * math.exp(x) for n, p in PER_RATIO.items()}) for x in LENGTHS
    ])  # fmt: skip
    constant = SAMPLES * math.log(NOISE * math.sqrt(2 * math.pi))
    return np.array([-0.5 * np.sum((motions - one) ** 2, axis=1) / NOISE**2 - constant for one in y])


def spread_out(logs: np.ndarray, spread: float) -> np.ndarray:
    """Log of the mean likelihood of each run over its factor, at each length, (3, n)."""
    if spread == 0:
        return logs
    step = LENGTHS[1] - LENGTHS[0]
    apart = LENGTHS[:, None] - LENGTHS
    kernel = np.exp(-0.5 * (apart / spread) ** 2) * step / (spread * math.sqrt(2 * math.pi))
    kernel /= np.maximum(kernel[600].sum(), 1e-300)  # a spread below the step is none
    tops = logs.max(axis=1, keepdims=True)
    return np.log(np.maximum(np.exp(logs - tops) @ kernel.T, 1e-300)) + tops


def weigh(t: np.ndarray, y: list[np.ndarray], damping: tuple[str, ...]) -> dict[str, float]:
    names = [{"viscous": "zeta", "coulomb": "mu_c"}[d] for d in damping]
    step, k = LENGTHS[1] - LENGTHS[0], len(names)
    angles = np.linspace(0.0, 0.5 * math.pi, ANGLES) if k == 2 else np.zeros(1)
    width = angles[1] - angles[0] if k == 2 else 1.0
    prior = np.exp(-0.5 * (SPREADS / SPREAD) ** 2) * 2 / (SPREAD * math.sqrt(2 * math.pi))
    weights = prior * (SPREADS[1] - SPREADS[0])
    weights[[0, -1]] *= 0.5
    alone, together = [[] for _ in y], []
    for angle in angles:
        direction = dict.fromkeys(PER_RATIO, 0.0)
        for name, part in zip(names, (math.cos(angle), math.sin(angle))):
            direction[name] = part if k == 2 else 1.0
        logs = log_likelihoods(t, y, direction)
        ratios = np.exp(LENGTHS)[:, None] * np.array([direction[n] for n in names])
        area = log_prior(ratios) + k * LENGTHS + math.log(step * width)
        if k == 2 and angle in (angles[0], angles[-1]):
            area = area - math.log(2)
        for j in range(len(y)):
            alone[j].append(logsumexp(logs[j] + area))
        each = [logsumexp(spread_out(logs, s).sum(axis=0) + area) for s in SPREADS]
        together.append(logsumexp(each, b=weights))
    return {
        "together": float(logsumexp(together)),
        **{f"run {j + 1}": float(logsumexp(one)) for j, one in enumerate(alone)},
    }


def make() -> dict:
    t, y = runs()
    return {
        "problem": {
            "omega": OMEGA, "amplitude": AMPLITUDE, "noise_sd": NOISE, "restoring": "linear", "spread": SPREAD,
        },
        "truth": {"ratios": RATIOS, "factors": FACTORS},
        "records": {"t": t.tolist(), "y": [one.tolist() for one in y]},
        "sums": {"+".join(s): weigh(t, y, s) for s in SUMS},
        "made": {
            "by": "tests/reference/make_repeats_reference.py", "lengths": LENGTHS.size, "angles": ANGLES,
            "python": platform.python_version(), "numpy": np.__version__, "scipy": scipy.__version__,
        },
    }  # fmt: skip


if __name__ == "__main__":
    found = make()
    Path(__file__).with_name("repeats.json").write_text(json.dumps(found, indent=1) + "\n")
    print(json.dumps(found["sums"], indent=1))
