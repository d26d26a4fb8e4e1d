"""Make the reference evidence of a lightly damped record by quadrature; nothing of the package is used.

    python tests/reference/make_light_reference.py      # a minute; writes light.json beside this file

The oscillator is linear, with viscous damping and dry friction whose sign is exact, so the motion between two turning
points is a damped cosine about a shifted rest position. The damping ratios are about 1e-4. Both coefficients have
half-normal priors on their equivalent damping ratios with one scale σ, which is log-uniform between 1e-8 and 0.3 and is
integrated finely. Everything else is known. The file holds the record, the log evidence of each damping sum, and means
and standard deviations of the coefficients.
"""

from __future__ import annotations

import json
import math
import platform
from pathlib import Path

import numpy as np
import scipy
import scipy.optimize
from scipy.special import logsumexp

OMEGA, AMPLITUDE = 4.5, 0.3
TRUTH = {"zeta": 1.0e-4 * OMEGA, "mu_c": 0.5e-4 * 0.5 * math.pi * OMEGA**2 * AMPLITUDE}
"""Equivalent damping ratios of 1e-4 and 0.5e-4: ζ/ω, and 2μ/(π ω² A) from the energy 4μA lost in a cycle."""
NOISE, CYCLES, SAMPLES, SEED = 3e-4, 40, 400, 21
RANGE = (1e-8, 0.3)
SUMS = (("viscous",), ("coulomb",), ("viscous", "coulomb"))
REACH, NODES, SCALES = 9.0, 64, 4000


def motion(t: np.ndarray, zeta: float, mu_c: float) -> np.ndarray:
    """θ at times t, (n,), released from AMPLITUDE at rest: half swings in closed form."""
    w = math.sqrt(OMEGA**2 - zeta**2)
    half, shift = math.pi / w, mu_c / OMEGA**2
    out = np.empty_like(t)
    start, x0, first = 0.0, AMPLITUDE, 0
    while first < t.size:
        rest = math.copysign(shift, x0)  # friction pushes against the motion towards the other side
        if abs(x0) <= shift:
            out[first:] = x0
            break
        last = int(np.searchsorted(t, start + half, side="right"))
        s = t[first:last] - start
        out[first:last] = rest + (x0 - rest) * np.exp(-zeta * s) * (np.cos(w * s) + zeta / w * np.sin(w * s))
        x0 = rest - (x0 - rest) * math.exp(-zeta * half)
        start, first = start + half, last
    return out


def log_prior(ratios: np.ndarray) -> np.ndarray:
    """Log density of equivalent damping ratios, (m, k), by the trapezoidal rule over log σ."""
    logs = np.linspace(math.log(RANGE[0]), math.log(RANGE[1]), SCALES)
    weights = np.full(SCALES, 1.0 / (SCALES - 1))
    weights[[0, -1]] *= 0.5
    sigma, squares = np.exp(logs), np.sum(ratios**2, axis=1)
    each = -0.5 * squares[:, None] / sigma**2 + ratios.shape[1] * (0.5 * math.log(2 / math.pi) - logs)
    return np.asarray(logsumexp(each, axis=1, b=weights))


def weigh(t: np.ndarray, y: np.ndarray, damping: tuple[str, ...]) -> dict:
    """Log evidence, and means and sds of the coefficients, by Gauss and Legendre's rule about the best fit."""
    names = [{"viscous": "zeta", "coulomb": "mu_c"}[d] for d in damping]
    per_ratio = np.array([{"zeta": OMEGA, "mu_c": 0.5 * math.pi * OMEGA**2 * AMPLITUDE}[n] for n in names])

    def residual(ratios: np.ndarray) -> np.ndarray:
        p = {"zeta": 0.0, "mu_c": 0.0, **dict(zip(names, per_ratio * ratios))}
        return (y - motion(t, **p)) / NOISE

    best = scipy.optimize.least_squares(
        residual, np.full(len(names), 1e-4), bounds=(0.0, 1e-2), x_scale=1e-4, xtol=1e-14, ftol=1e-14
    )
    covariance = np.linalg.inv(best.jac.T @ best.jac)
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    # The last coefficient in few of its own sds about where the first one leaves it: both make a narrow ridge.
    grid, cells = np.zeros((1, 0)), np.zeros(1)
    for i in range(len(names)):
        slope = np.linalg.solve(covariance[:i, :i], covariance[:i, i])
        centre = best.x[i] + (grid - best.x[:i]) @ slope
        sd = math.sqrt(covariance[i, i] - covariance[i, :i] @ slope)
        low, high = np.maximum(centre - REACH * sd, 0.0), np.maximum(centre + REACH * sd, 0.0)
        x = low[:, None] + 0.5 * (high - low)[:, None] * (nodes + 1)
        with np.errstate(divide="ignore"):  # where nothing is left above zero
            area = np.log(0.5 * (high - low))[:, None] + np.log(weights)
        grid = np.column_stack([np.repeat(grid, NODES, axis=0), x.ravel()])
        cells = np.repeat(cells, NODES) + area.ravel()
    cost = np.array([np.sum(residual(r) ** 2) for r in grid])
    logs = -0.5 * cost - y.size * math.log(NOISE * math.sqrt(2 * math.pi)) + log_prior(grid) + cells
    total = float(logsumexp(logs))
    p = np.exp(logs - total)
    mean = p @ grid
    spread = np.sqrt(p @ (grid - mean) ** 2)
    return {
        "log_evidence": total,
        "mean": dict(zip(names, (per_ratio * mean).tolist())),
        "sd": dict(zip(names, (per_ratio * spread).tolist())),
    }


def make() -> dict:
    rng = np.random.default_rng(SEED)
    t = np.linspace(0.0, 2 * math.pi * CYCLES / OMEGA, SAMPLES)
    y = motion(t, **TRUTH) + NOISE * rng.standard_normal(SAMPLES)
    return {
        "problem": {
            "omega": OMEGA, "amplitude": AMPLITUDE, "noise_sd": NOISE, "restoring": "linear", "scales": RANGE,
        },
        "truth": TRUTH,
        "record": {"t": t.tolist(), "y": y.tolist()},
        "sums": {"+".join(s): weigh(t, y, s) for s in SUMS},
        "made": {
            "by": "tests/reference/make_light_reference.py", "nodes": NODES, "scales": SCALES,
            "python": platform.python_version(), "numpy": np.__version__, "scipy": scipy.__version__,
        },
    }  # fmt: skip


if __name__ == "__main__":
    found = make()
    Path(__file__).with_name("light.json").write_text(json.dumps(found, indent=1) + "\n")
    print(json.dumps(found["sums"], indent=1))
