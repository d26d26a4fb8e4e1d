"""Compute by how many nats the true damping sum is ahead of the best sum that lacks one of its terms."""

import numpy as np
from scipy.optimize import least_squares, nnls

from validation.truth.drawing import Draw, loss_rate
from validation.truth.oscillator import LAWS, TERMS
from validation.truth.trajectory import trajectory

PER_CYCLE, STEPS = 24, 3
"""Number of samples in a cycle at which trajectories are compared, and of solver steps between two of these samples."""


def nats_ahead(draw: Draw) -> float:
    """Return by how many nats the true sum of a draw is ahead of the best sum that lacks one of its terms.

    The trajectories of these rivals are fitted to the true trajectory by least squares, without discrepancy and with an
    exact sign. Nats are half the smallest sum of squares over the variance of the noise. A sum with all true terms is
    not a rival, because it fits equally well. All sums without a term are special cases of the sum with all other
    terms, so this sum has the smallest residual.
    """
    truth, amplitude, frequency = draw.oscillator, draw.amplitude, draw.frequency
    law = list(LAWS).index(truth.restoring)
    names = LAWS[truth.restoring]
    step = 2 * np.pi / frequency / (PER_CYCLE * STEPS)
    out = np.empty((max(int(draw.duration / (STEPS * step)), 2) + 1, 2))

    def motion(law_values: np.ndarray, damping: np.ndarray, start: np.ndarray) -> np.ndarray:
        padded = np.zeros(3)
        padded[: law_values.size] = law_values
        trajectory(law, padded, damping, float(start[0]), float(start[1]), step, STEPS, out)
        return out

    law_true = np.array([truth.parameters[name] for name in names])
    true = np.array([truth.damping.get(term, 0.0) for term in TERMS])
    start = np.array([truth.equilibrium() + draw.displacement, 0.0])
    path = motion(law_true, true, start).copy()

    grid = np.geomspace(draw.left, 1.0, 24) * amplitude
    rates = np.column_stack([loss_rate(term, grid, frequency) for term in TERMS])
    total = rates @ true
    unit = 1 / rates[12]
    law_scale = np.array([
        {"stiffness": frequency**2, "gravity": frequency**2, "cubic": frequency**2 / amplitude**2}.get(n, amplitude)
        for n in names
    ])  # fmt: skip
    shift = np.concatenate([law_scale, amplitude * np.array([1.0, frequency])])
    origin = np.concatenate([law_true, start])
    costs = []
    for term in truth.damping:
        others = [i for i, other in enumerate(TERMS) if other != term]
        guess = nnls(rates[:, others] * unit[others] / total[:, None], np.ones(grid.size))[0]
        guess = np.maximum(guess, 1e-3 * total.mean())

        def residual(x: np.ndarray, others: list[int] = others) -> np.ndarray:
            moved = origin + shift * x[:-2]
            damping = np.zeros(3)
            damping[others] = x[-2:] * unit[others]
            rival = motion(moved[: law_true.size], damping, moved[law_true.size :])
            return (rival[:, 0] - path[:, 0]) / (draw.noise * amplitude)

        low = np.concatenate([np.full(shift.size, -np.inf), np.zeros(2)])
        scale = np.concatenate([np.full(shift.size, 1e-2), np.full(2, total.mean())])
        best = least_squares(
            residual, np.concatenate([np.zeros(shift.size), guess]), bounds=(low, np.inf), x_scale=scale, ftol=1e-3,
            xtol=1e-7, gtol=1e-12, max_nfev=40,
        )  # fmt: skip
        costs.append(float(best.cost))
    return min(costs) * int(draw.cycles * draw.per_cycle) / len(out)
