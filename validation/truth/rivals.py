"""How many nats a record of a damping sum is ahead of the best sum that lacks one of its terms."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares, nnls

from validation.truth.oscillator import LAWS, TERMS, Oscillator
from validation.truth.trajectory import trajectory

PER_CYCLE, STEPS = 24, 3
"""Samples a cycle that are compared, and steps between two of them."""


def loss_rate(term: str, amplitude: float | np.ndarray, frequency: float) -> float | np.ndarray:
    """Equivalent damping ratio per unit of a term's coefficient for a harmonic motion (rad, rad/s)."""
    if term == "viscous":
        return 1 / frequency + 0 * amplitude
    if term == "coulomb":
        return 2 / (np.pi * frequency**2 * amplitude)
    return 4 * amplitude / (3 * np.pi)


def nats_ahead(
    truth: Oscillator, theta0: float, omega0: float, amplitude: float, left: float, frequency: float, duration: float,
    samples: int, noise_sd: float,
) -> dict[str, float]:  # fmt: skip
    """By the term that a rival lacks, how many nats the truth is ahead of it.

    By least squares of the rivals' trajectories to the true one, without discrepancy and with an exact sign.

    theta0, omega0: state at the start (rad, rad/s). amplitude (rad), frequency (rad/s): of the motion. left: share of
    the amplitude at the end. duration: s. samples, noise_sd: the record's number of samples and the noise of each, rad.
    Nats are half the least sum of squares over the noise's variance. Sums that hold all true terms are no rivals here:
    they fit as well, and only their number of parameters counts against them. Those that lack a term are all within
    the one that has all others, whose residual is the least.
    """
    law = list(LAWS).index(truth.restoring)
    names = LAWS[truth.restoring]
    step = 2 * np.pi / frequency / (PER_CYCLE * STEPS)
    out = np.empty((max(int(duration / (STEPS * step)), 2) + 1, 2))

    def motion(law_values: np.ndarray, damping: np.ndarray, start: np.ndarray) -> np.ndarray:
        padded = np.zeros(3)
        padded[: law_values.size] = law_values
        trajectory(law, padded, damping, float(start[0]), float(start[1]), step, STEPS, out)
        return out

    law_true = np.array([truth.parameters[name] for name in names])
    true = np.array([truth.damping.get(term, 0.0) for term in TERMS])
    start = np.array([theta0, omega0])
    path = motion(law_true, true, start).copy()

    grid = np.geomspace(left, 1.0, 24) * amplitude
    rates = np.column_stack([loss_rate(term, grid, frequency) for term in TERMS])
    total = rates @ true
    unit = 1 / rates[12]
    law_scale = np.array([
        {"stiffness": frequency**2, "gravity": frequency**2, "cubic": frequency**2 / amplitude**2}.get(n, amplitude)
        for n in names
    ])  # fmt: skip
    shift = np.concatenate([law_scale, amplitude * np.array([1.0, frequency])])
    origin = np.concatenate([law_true, start])
    nats = {}
    for term in truth.damping:
        kept = [i for i, other in enumerate(TERMS) if other != term]
        guess = nnls(rates[:, kept] * unit[kept] / total[:, None], np.ones(grid.size))[0]
        guess = np.maximum(guess, 1e-3 * total.mean())

        def residual(x: np.ndarray, kept: list[int] = kept) -> np.ndarray:
            moved = origin + shift * x[:-2]
            damping = np.zeros(3)
            damping[kept] = x[-2:] * unit[kept]
            found = motion(moved[: law_true.size], damping, moved[law_true.size :])
            return (found[:, 0] - path[:, 0]) / noise_sd

        low = np.concatenate([np.full(shift.size, -np.inf), np.zeros(2)])
        scale = np.concatenate([np.full(shift.size, 1e-2), np.full(2, total.mean())])
        best = least_squares(
            residual, np.concatenate([np.zeros(shift.size), guess]), bounds=(low, np.inf), x_scale=scale, ftol=1e-3,
            xtol=1e-7, gtol=1e-12, max_nfev=40,
        )  # fmt: skip
        nats[term] = float(best.cost * samples / len(out))
    return nats
