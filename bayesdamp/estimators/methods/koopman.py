"""Estimate damping by extended dynamic mode decomposition, a linear model of a dictionary of functions of the state.

The method is that of section 3.12, equations 24 and 25, of the paper that `bayesdamp.estimators` cites.
"""

import numpy as np
from pydantic import Field
from scipy.linalg import logm

from bayesdamp.estimators.regression import CandidateTerm, candidates, derivatives, to_even_clock
from bayesdamp.estimators.shared import (
    Estimator,
    Options,
    SmoothedMotion,
    before_gap,
    checked_features,
    free_start,
    known_restoring,
    motion,
    oscillator,
    solve,
)
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

STEP = 1.0 / 1000.0
"""Time from one state to the next (the lag τ) for a record without noise, in periods; at least one sample is used."""
NOISY_STEP = 1.0 / 24.0
"""Time from one state to the next (the lag τ) for a record with noise, in periods."""
FILTER = 1.2
"""Width, in periods, of the smoothing filter that is applied to all observables (functions of the state) of a record
with noise."""
CLEAN_RANK, NOISY_RANK = 1e-9, 1e-3
"""Fraction of the largest singular value below which singular values are left out, for records without and with noise.
The singular values are those of the matrix of the dictionary's values along the record."""


class KoopmanOptions(Options):
    """Options of dynamic mode decomposition.

    lag: time from one state to the next in periods, or 0 to use `NOISY_STEP` for a record with noise and `STEP` for one
    without.
    """

    lag: float = Field(default=0.0, ge=0.0, le=0.2)


class Koopman(Estimator[KoopmanOptions]):
    """Fit g(x(t + τ)) ≈ K g(x(t)); the damping follows from the generator log(K)/τ.

    x = (θ, θ̇) is the state, and g(x) the dictionary of the paper: functions of the state, which `candidates` returns
    with the option `mixed`.

    The row of the generator for θ̇ gives the acceleration along the record. This acceleration, together with the known
    restoring force, is regressed on the unknown damping and restoring terms of the equation of motion.
    Noise in the observables, and a dictionary that is not closed, change log K equally for steps forwards and backwards
    in time; half the difference of both is unbiased to first order. For a record with noise, the same linear filter is
    applied to all observables, which preserves linear relations between them, and the lag is many samples.
    """

    options = KoopmanOptions

    def initial(
        self, signal: Signal, problem: Problem, options: KoopmanOptions, rng: np.random.Generator
    ) -> Estimate:
        """Estimate the generator from the record, and the coefficients by regression of the acceleration that it gives.

        The result includes unknown restoring parameters, and an unknown start, which comes from the smoothed record. It
        has no standard errors. Raises Refusal if `checked_features` or `motion` does, if the record is too short, or if
        K has no real logarithm.
        """
        features = checked_features(signal)
        library = candidates(problem, features, signal.unit, mixed=True)
        osc = oscillator(problem)
        smoothed = motion(signal, problem, features)
        before, after, columns, offset, lag = observe(
            signal, smoothed, problem, library, features, options.lag
        )
        rank = CLEAN_RANK if smoothed.clean else NOISY_RANK
        generator, directions, back = decompose(before, after, lag, rank)

        index = {candidate.damping: i for i, candidate in enumerate(library) if candidate.damping}
        # The observable is 2θ̇, so half of its row expresses θ̈ in the dictionary.
        row = 0.5 * back.T[index["viscous"]] @ generator @ directions.T
        shapes = before[:, [index[name] for name in problem.damping]]
        x = solve(np.column_stack([shapes, columns]), -(before @ row) - offset, 1e-12)
        values = {name: float(c) for name, c in zip(osc.coefficients, x)}
        if columns.shape[1]:
            form = osc.law.linear_form(smoothed.everywhere[0], known_restoring(problem))
            values |= form.decode(x[shapes.shape[1] :])
        values |= free_start(problem, smoothed.theta0, smoothed.omega0)
        return Estimate(self.name, "initial", values, evaluations=2)


def observe(
    signal: Signal,
    smoothed: SmoothedMotion,
    problem: Problem,
    library: list[CandidateTerm],
    features: Features,
    lag: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    """Compute the values of the functions of the dictionary along the record, at times in pairs that are one lag apart.

    Only the record before its first interruption of the sampling is used (`before_gap`). The state comes from the
    smoothed motion, interpolated to uniform times if necessary. For a noisy record all observables pass the same
    compact filter; for a recorded angle, θ and 2θ̇ are computed by this filter from the record itself. library: the
    functions of the dictionary. lag: in periods, rounded to whole samples; 0 to choose it by the noise. Raises Refusal
    if the record is too short.

    Returns
    -------
    tuple
        The values of the p functions of the dictionary at m times, and one lag later, (m, p) each; the restoring force
        at the m times as a linear form offset + columns @ coefficients of its c unknown coefficients (`LinearForm`),
        with the same filter: columns (m, c) and offset (m,); and the lag in s.
    """
    signal, p = before_gap(signal, features.period), len(library)
    form = oscillator(problem).law.linear_form(smoothed.everywhere[0], known_restoring(problem))
    h = float(np.diff(signal.t).mean())
    step = max(1, round((lag or (STEP if smoothed.clean else NOISY_STEP)) * features.period / h))
    curves = (signal.y, *smoothed.everywhere[:2], *form.columns.T, form.offset)
    t, y, theta, omega, *of_law = to_even_clock(signal.t, h, *curves)
    g = np.column_stack([*(candidate.function(theta, omega) for candidate in library), *of_law])
    if smoothed.clean:
        edge = min(20, t.size // 10)
        g = g[edge : t.size - edge]
    else:
        half = max(int(FILTER * features.period / h) // 2, 3)
        s = np.arange(-half, half + 1) / half
        kernel = derivatives(s, 0)
        total = kernel.sum()
        g = np.column_stack([np.convolve(column, kernel / total, "valid") for column in g.T])
        slope = derivatives(s, 1) / (h * half) / total
        for i, candidate in enumerate(library if signal.quantity == "angle" else ()):
            if candidate.damping == "viscous":
                g[:, i] = 2.0 * np.convolve(y, slope, "valid")
            elif candidate.name == "θ":
                g[:, i] = np.convolve(y, kernel / total, "valid")
    if g.shape[0] <= step + 4 * p:
        raise Refusal(
            f"the record is too short: it has too few pairs of states that are {step * h:.3g} s (one lag) apart"
        )
    return g[:-step, :p], g[step:, :p], g[:-step, p:-1], g[:-step, -1], step * h


def decompose(
    before: np.ndarray, after: np.ndarray, lag: float, rank: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimate the generator log(K)/lag of the matrix K that maps the values `before` to the values `after`.

    The maps forwards and backwards in time are fitted by least squares in the basis of the leading singular vectors of
    the values. before, after: values of p functions at m times, and one lag later, (m, p) each. lag: in s. rank:
    fraction of the largest singular value below which singular vectors are left out.

    Returns
    -------
    tuple
        The generator in 1/s, (r, r), in the basis of r singular vectors; the maps from observables to this basis,
        (p, r), and back, (r, p). The generator multiplies column vectors; the maps are for rows (values @ map). It is
        (log K − log K')/(2 lag), with the matrices K of one step forwards and K' of one step backwards.

    Raises
    ------
    Refusal
        If K or K' has no real logarithm.
    """
    both = np.vstack([before, after])
    scale = np.linalg.norm(both, axis=0)
    _, sizes, vectors = np.linalg.svd(np.linalg.qr(both / scale, mode="r"))
    explored = sizes > rank * sizes[0]
    turn = vectors[explored].T / sizes[explored]
    before, after = before / scale @ turn, after / scale @ turn
    forwards = np.linalg.lstsq(before, after, rcond=None)[0].T
    backwards = np.linalg.lstsq(after, before, rcond=None)[0].T
    generator = (_log(forwards) - _log(backwards)) / (2.0 * lag)
    return generator, turn / scale[:, None], (vectors[explored] * sizes[explored, None]) * scale


def _log(matrix: np.ndarray) -> np.ndarray:
    """Return the real principal logarithm, (d, d), of a real matrix, (d, d).

    Raises Refusal if an eigenvalue is real and not positive, because there is then no real principal logarithm.
    """
    values = np.linalg.eigvals(matrix)
    if np.any((np.abs(values.imag) <= 1e-12 * np.abs(values).max()) & (values.real <= 0)):
        raise Refusal(
            "the one-step matrix has an eigenvalue that is zero or negative, so it has no real principal logarithm"
        )
    # SciPy estimates norms with NumPy's global random state: fix it, and restore it afterwards.
    before = np.random.get_state()
    np.random.seed(0)
    try:
        return np.real(np.asarray(logm(matrix)))
    finally:
        np.random.set_state(before)


PLUGIN = Koopman()
