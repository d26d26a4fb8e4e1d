"""Compute by how many nats the true damping sum fits better than the best sum that lacks one of its terms."""

import numpy as np
from scipy.optimize import least_squares, nnls

from validation.truth.drawing import Draw, loss_rate
from validation.truth.oscillator import LAWS, TERMS
from validation.truth.trajectory import trajectory

PER_CYCLE, STEPS = 24, 3
"""Number of samples in a cycle at which trajectories are compared, and number of solver steps between two of these."""


def nats_ahead(draw: Draw) -> float:
    """Return by how many nats the true damping sum of a draw fits better than the best sum that lacks one of its terms.

    The result is a difference in log likelihood: half the smallest sum of squares of the wrong sums, divided by the
    variance of the noise. The trajectories of the wrong sums are fitted by least squares to the true trajectory, which
    has no discrepancy and an exact sign of the velocity in the friction. For each true term, only the sum of all other
    terms is fitted. Other sums without this term are special cases of it and fit no better. Sums with all true terms
    are not wrong, because they fit as well as the truth.
    """
    truth, amplitude, frequency = draw.oscillator, draw.amplitude, draw.frequency
    law, names = list(LAWS).index(truth.restoring), LAWS[truth.restoring]
    step = 2 * np.pi / frequency / (PER_CYCLE * STEPS)
    out = np.empty((max(int(draw.duration / (STEPS * step)), 2) + 1, 2))

    def angles(values: np.ndarray) -> np.ndarray:
        """Return the angles of a motion. values: p (6,) of `trajectory`, then initial angle and velocity."""
        trajectory(law, values[:6], float(values[6]), float(values[7]), step, STEPS, out)
        return out[:, 0]

    grid = np.geomspace(draw.left, 1.0, 24) * amplitude
    rates = np.column_stack([loss_rate(term, grid, frequency) for term in TERMS])
    sizes = {"stiffness": frequency**2, "gravity": frequency**2, "cubic": frequency**2 / amplitude**2}
    unit = np.full(8, amplitude)
    unit[: len(names)] = [sizes.get(name, amplitude) for name in names]
    unit[3:6], unit[7] = 1 / rates[12], amplitude * frequency
    origin = np.zeros(8)
    origin[: len(names)] = [truth.parameters[name] for name in names]
    origin[6] = truth.equilibrium() + draw.displacement
    coefficients = np.array([truth.damping.get(term, 0.0) for term in TERMS])
    total = rates @ coefficients
    path = angles(np.concatenate([origin[:3], coefficients, origin[6:]])).copy()
    costs = []
    for term in truth.damping:
        others = [3 + i for i, other in enumerate(TERMS) if other != term]
        free = [*range(len(names)), 6, 7, *others]
        guess = np.zeros(len(free))
        columns = rates[:, np.array(others) - 3] * unit[others] / total[:, None]
        guess[-2:] = np.maximum(nnls(columns, np.ones(grid.size))[0], 1e-3 * total.mean())

        def residual(x: np.ndarray, free: list[int] = free) -> np.ndarray:
            values = origin.copy()
            values[free] += unit[free] * x
            return (angles(values) - path) / (draw.noise * amplitude)

        low, scale = np.full(len(free), -np.inf), np.full(len(free), 1e-2)
        low[-2:], scale[-2:] = 0.0, total.mean()
        best = least_squares(
            residual,
            guess,
            bounds=(low, np.inf),
            x_scale=scale,
            ftol=1e-3,
            xtol=1e-7,
            gtol=1e-12,
            max_nfev=40,
        )
        costs.append(float(best.cost))
    return min(costs) * int(draw.cycles * draw.per_cycle) / len(out)
