"""What the estimators with a network share: dense networks, their training, and a record in its own scales.

All derivatives are worked out by hand: a network of a few hundred weights is evaluated too often, and each time too
quickly, for a library's automatic ones.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy  # loads its modules when they are used
from numpy.polynomial import Polynomial

from bayesdamp.estimators.shared import (
    ORDER,
    epsilon_of,
    oscillator,
    ratios_per_unit,
    start_parameters,
    thin_record,
)
from bayesdamp.physics.forces import slope_of
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import OK, Problem, Signal

WITHIN = 1e-2
"""Step of differences by the velocity, as a share of the width of a switch."""
MOST_SAMPLES = 1500
BIAS = 0.5
"""Standard deviation of a network's first biases."""
COLLINEAR = 1e-3
"""Share of the largest singular value below which a direction is left out of the first output layer."""
FIRST, LOWEST, LESS, MORE = 1e-3, 1e-14, 0.2, 5.0
"""Damping of the first step, its lowest value, and its factors after a step that lowers the loss, if the one before did
too, and after a step that does not (conventional)."""
AHEAD, STRAIGHT = 0.1, 0.375
"""Share of a step over which its second derivative is measured, and how much it may bend (Transtrum & Sethna)."""
TRIALS = 12
"""Steps that are tried from one point."""
WINDOW = 8
"""Rounds over which the watched numbers must be steady."""


@dataclass(frozen=True)
class DenseNetwork:
    """A network with tanh in its hidden layers and one output, as a function of its inputs and its weights (k,).

    A jet is a function of time with its derivatives: value, first, second, or fewer of them.
    sizes: of the layers, from the inputs to the output. biased: without biases, the output is an odd function.
    """

    sizes: tuple[int, ...]
    biased: bool = True

    @property
    def count(self) -> int:
        """Number of weights."""
        return sum(outputs * (inputs + self.biased) for inputs, outputs in itertools.pairwise(self.sizes))

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw first weights (k,): matrices of variance 1/inputs (Glorot's for equal sizes), and biases."""
        weights = rng.standard_normal(self.count)
        for matrix, bias in self._layers(weights):
            matrix /= matrix.shape[1] ** 0.5
            bias *= BIAS
        return weights

    def jets(self, weights: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """Return the output's jets (j, n) for the jets of the inputs (j, n, sizes[0])."""
        return self._forward(weights, inputs)[0]

    def slopes(self, weights: np.ndarray, inputs: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Return the derivatives by the weights, (n, k), of the sum of shares (j, n) times the output's jets."""
        _, before, after = self._forward(weights, inputs)
        adjoint, by_layer = shares[:, :, None], []
        for i, (matrix, _) in reversed(list(enumerate(self._layers(weights)))):
            if i < len(before):
                z, h = before[i], after[i + 1][0]
                slope = 1.0 - h * h
                bend = -2.0 * h * slope
                by_z = adjoint * slope
                if len(z) > 1:
                    by_z[0] += adjoint[1] * bend * z[1]
                if len(z) > 2:
                    by_z[0] += adjoint[2] * (bend * z[2] - 2.0 * slope * (slope - 2.0 * h * h) * z[1] ** 2)
                    by_z[1] += adjoint[2] * (2.0 * bend * z[1])
                adjoint = by_z
            by_matrix = sum(a[:, :, None] * b[:, None, :] for a, b in zip(adjoint, after[i]))
            by_bias = [adjoint[0]] if self.biased else []
            by_layer.append([np.reshape(by_matrix, (shares.shape[1], -1)), *by_bias])
            adjoint = adjoint @ matrix
        return np.concatenate([part for layer in reversed(by_layer) for part in layer], axis=1)

    def fitted(self, weights: np.ndarray, inputs: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the weights (k,) with the output layer's fitted to y (n,), the last part of the output's jet."""
        last = self._forward(weights, inputs)[2][-1][-1]
        if self.biased:
            last = np.column_stack([last, np.full(y.size, float(len(inputs) == 1))])
        fit = np.linalg.lstsq(last, y, rcond=COLLINEAR)[0]
        return np.concatenate([weights[: -fit.size], fit])

    def _layers(self, weights: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return views of a weight vector as (matrix, bias) of each layer, (outputs, inputs) and (outputs,)."""
        network, start = [], 0
        for inputs, outputs in itertools.pairwise(self.sizes):
            middle = start + outputs * inputs
            end = middle + outputs * self.biased
            network.append((weights[start:middle].reshape(outputs, inputs), weights[middle:end]))
            start = end
        return network

    def _forward(
        self, weights: np.ndarray, inputs: np.ndarray
    ) -> tuple[np.ndarray, list[np.ndarray], list[np.ndarray]]:
        """Return the output's jets (j, n), and the jets into and out of every hidden layer (j, n, units)."""
        before, after = [], [inputs]
        *hidden, (matrix, bias) = self._layers(weights)
        for inner, shift in hidden:
            z = after[-1] @ inner.T
            if self.biased:
                z[0] += shift
            h = np.tanh(z[0])
            slope = 1.0 - h * h
            parts = [h]
            if len(z) > 1:
                parts.append(slope * z[1])
            if len(z) > 2:
                parts.append(slope * (z[2] - 2.0 * h * z[1] ** 2))
            before.append(z)
            after.append(np.stack(parts))
        out = after[-1] @ matrix[0]
        if self.biased:
            out[0] += bias
        return out, before, after


class Round(NamedTuple):
    """A point of a descent: the unknowns (k,), the loss there, and how often the residuals were evaluated so far."""

    x: np.ndarray
    loss: float
    evaluations: int


def descend(
    residuals: Callable[[np.ndarray], np.ndarray],
    linearise: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    x: np.ndarray,
) -> Iterator[Round]:
    """Lower the sum of squares of residuals (n,) step by step, for up to a few thousand unknowns.

    It uses Levenberg's method with geodesic acceleration (Transtrum & Sethna 2012, arXiv:1201.5885): a step is bent by
    the residuals' second derivative along it, and refused if it bends too much. All unknowns are damped alike: scaled
    by their curvature, as Marquardt proposed, weights without effect would grow without bounds.
    It ends when no step lowers the loss.

    Parameters
    ----------
    residuals
        Maps x (k,) to the residuals (n,).
    linearise
        Maps x to the residuals and their Jacobian (n, k).
    x
        The first unknowns, (k,).

    Yields
    ------
    Round
        The start, and the end of each step.
    """
    evaluations, damping, failed = 0, FIRST, False
    while True:
        r, jacobian = linearise(x)
        evaluations += 1
        loss = float(r @ r)
        yield Round(x, loss, evaluations)
        gradient, hessian = jacobian.T @ r, jacobian.T @ jacobian
        unit = float(hessian.diagonal().mean()) * np.eye(x.size)
        for _ in range(TRIALS):
            try:
                factor = scipy.linalg.cho_factor(hessian + damping * unit, check_finite=False)
            except np.linalg.LinAlgError:
                damping, failed = damping * MORE, True
                continue
            step = -scipy.linalg.cho_solve(factor, gradient, check_finite=False)
            curvature = 2 / AHEAD * ((residuals(x + AHEAD * step) - r) / AHEAD - jacobian @ step)
            bend = -scipy.linalg.cho_solve(factor, jacobian.T @ curvature, check_finite=False) / 2
            end = residuals(x + step + bend)
            evaluations += 2
            if np.linalg.norm(bend) <= STRAIGHT * np.linalg.norm(step) and float(end @ end) < loss:
                x, damping, failed = (
                    x + step + bend,
                    damping if failed else max(damping * LESS, LOWEST),
                    False,
                )
                break
            damping, failed = damping * MORE, True
        else:
            return


@dataclass(frozen=True)
class Training:
    """The result of a training.

    x (k,): the last unknowns. losses, watched: the loss and the watched numbers of each round. evaluations: of the
    residuals. outcome: OK, or that the training had not converged.
    """

    x: np.ndarray
    losses: np.ndarray
    watched: np.ndarray
    evaluations: int
    outcome: str


def train(
    descent: Iterator[Round], rounds: int, watch: Callable[[np.ndarray], np.ndarray], steady: float = 2e-4
) -> Training:
    """Descend until the numbers that are sought no longer change.

    That is when they have stayed within `steady` of their size for `WINDOW` rounds, while the loss did not fall to a
    tenth.

    Parameters
    ----------
    descent
        The rounds of `descend`.
    rounds
        The largest number of steps.
    watch
        Maps the unknowns to the numbers (m,) that are sought, in units in which they are about 1.
    steady
        Largest relative change of a converged number.
    """
    course: list[Round] = []
    watched: list[np.ndarray] = []
    outcome = OK
    for point in descent:
        course.append(point)
        watched.append(watch(point.x))
        if not np.isfinite(point.loss):
            break
        if len(course) > WINDOW:
            last = np.array(watched[-WINDOW - 1 :])
            still = bool(np.all(np.ptp(last, axis=0) <= steady * (np.abs(last[-1]) + 1e-3)))
            if still and point.loss > 0.1 * course[-WINDOW - 1].loss:
                break
        if len(course) > rounds:
            outcome = f"training had not converged after {rounds} rounds"
            break
    losses = np.array([point.loss for point in course])
    return Training(course[-1].x, losses, np.array(watched), course[-1].evaluations, outcome)


class ScaledRecord:
    """A record and its oscillator in the record's scales: the amplitude a and the angular frequency w.

    t, recorded: samples, (n,) each. y: the samples about the rest, in amplitudes. base: all parameters but damping.
    ratios: equivalent damping ratio per unit of each coefficient.
    coefficients, restoring: names of the unknowns. given, begin: which of angle and velocity at the start are known,
    and their values in amplitudes.
    """

    def __init__(self, signal: Signal, problem: Problem, features: Features) -> None:
        osc, known = oscillator(problem), problem.system.known
        self.base = start_parameters(signal, problem, features)
        self.a, self.w, self.order = features.amplitude, features.frequency, ORDER[signal.quantity]
        self.rest = features.rest if self.order == 0 else osc.equilibrium(self.base)
        self.ratios = ratios_per_unit(problem, features)
        self.coefficients = osc.coefficients
        self.restoring = tuple(name for name in osc.law.parameters if name not in known)
        self._osc, self._epsilon = osc, epsilon_of(problem, features)
        self.t, self.recorded = thin_record(signal, features, MOST_SAMPLES)
        middle = self.rest if self.order == 0 else 0.0
        self.y = (self.recorded - middle) / (self.a * self.w**self.order)
        wanted = [(known.get("theta0"), self.rest, self.a), (known.get("omega0"), 0.0, self.a * self.w)]
        self.given = [i for i, (value, _, _) in enumerate(wanted) if value is not None]
        self.begin = np.array([(v - zero) / unit for v, zero, unit in wanted if v is not None])

    def restoring_force(self, theta: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return F_rest, rad/s², at angles of any shape, for values (k,) of the unknown restoring parameters."""
        return self._osc.law.force(theta, self._law(values))

    def restoring_slopes(self, theta: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of F_rest by the angle, of its shape (…), and by `restoring`, (…, k)."""
        law, p = self._osc.law, self._law(values)
        by = np.zeros((*theta.shape, len(self.restoring)))
        for i, name in enumerate(self.restoring):
            by[..., i] = slope_of(
                lambda v, name=name: law.force(theta, {**p, name: v}), np.full(theta.shape, p[name])
            )
        return law.slope(theta, p), by

    def _law(self, values: np.ndarray) -> dict[str, float]:
        return self.base | dict(zip(self.restoring, values.tolist()))

    def damping_shapes(self, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the damping force per unit of each coefficient and its slope by θ̇, both (n, terms)."""
        still = np.zeros_like(omega)
        step = WITHIN * self._epsilon if self._osc.switches and self._epsilon > 0 else None
        values, slopes = [], []
        for term in self._osc.terms:
            values.append(term.force(still, omega, self._epsilon))
            slopes.append(slope_of(lambda v, t=term: t.force(still, v, self._epsilon), omega, step))
        return np.column_stack(values), np.column_stack(slopes)


def phase_of(signal: Signal, features: Features) -> Polynomial:
    """Return the phase of a record in rad, which grows by π from each crossing of the midline to the next.

    It is a polynomial in time: of degree 3 if the crossings span most of the record, so that it follows a frequency
    that drifts with the amplitude, else a straight line.
    """
    crossings, count = features.crossing_times, features.crossing_times.size
    span = (crossings[-1] - crossings[0]) / (signal.t[-1] - signal.t[0]) if count else 0.0
    if count >= 8 and span > 0.75:
        weight = np.abs(features.turning_amplitudes[1:] * features.turning_amplitudes[:-1]) ** 0.5
        return Polynomial.fit(crossings, np.pi * np.arange(count), 3, w=weight)
    return Polynomial([-features.frequency * features.turning_times[0], features.frequency])
