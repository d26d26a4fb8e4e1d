"""Physics-informed neural network (paper, section 3.5, equations 17 to 19).

θ(t) is a network whose inputs are time and the sines and cosines of the record's own phase and its harmonics; angles
are in amplitudes and the residual of the equation of motion in units of Aω². Damping coefficients are trained along
with the weights. Time derivatives are carried through the network by hand, and the loss, a sum of squares, is
lowered by Levenberg–Marquardt steps.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.networks import DenseNetwork, ScaledRecord, descend, phase_of, train
from bayesdamp.estimators.shared import checked_features, decay_start, free_start
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

UNIT = 3.0
"""Factor of the physical parameters' units: the larger, the less they are damped in comparison with the weights."""
UNINFORMED = 0.05
"""Equivalent damping ratio of each term at an uninformed start."""


class PinnOptions(Options):
    """Options of the physics-informed network.

    start: damping at an equivalent ratio of 0.05, whatever the record, or from its loss of energy.
    width: units in each of the two hidden layers. harmonics: of the record's frequency among the inputs.
    collocation: number of instants at which the equation of motion is evaluated.
    physics_weight, start_weight: λ1 and λ2 of equation (17). rounds: largest number of training steps.
    """

    start: Literal["uninformed", "direct"] = "uninformed"
    width: int = Field(default=14, ge=4, le=64)
    harmonics: int = Field(default=3, ge=1, le=10)
    collocation: int = Field(default=500, ge=50, le=5000)
    physics_weight: float = Field(default=10.0, gt=0.0)
    start_weight: float = Field(default=10.0, ge=0.0)
    rounds: int = Field(default=300, ge=1, le=5000)


class Pinn(Estimator[PinnOptions]):
    """Damping coefficients, and free restoring parameters, of a network trained on record and equation of motion.

    A negative coefficient is reported as it is.
    """

    by_position = "the damping in its loss is a function of the velocity alone"
    with_parameters = "its loss has one weight for each term"
    options = PinnOptions

    def initial(
        self, signal: Signal, problem: Problem, options: PinnOptions, rng: np.random.Generator
    ) -> Estimate:
        """Train coefficients together with a network for the motion, by its residual in the equation."""
        loss = Collocation(signal, problem, checked_features(signal), options, rng)
        first, last = loss.network.count, loss.network.count + len(loss.coefficients)
        descent = descend(lambda x: np.concatenate(loss.residuals(x)), loss.linearise, loss.start)
        training = train(descent, options.rounds, lambda x: x[first:last])
        if not np.all(np.isfinite(training.losses)):
            raise Refusal("the network's training came to numbers that are not finite")
        x, watched = training.x, training.watched * loss.units[: last - first]
        values = dict(zip((*loss.coefficients, *loss.restoring), map(float, loss.physical(x))))
        angle, velocity = loss.network.jets(x[:first], loss.first)[:, 0].tolist()
        values |= free_start(problem, loss.rest + loss.a * angle, loss.a * loss.w * velocity)
        trace = {"loss": training.losses, **dict(zip(loss.coefficients, watched.T))}
        data, _, physics = (part / weight for part, weight in zip(loss.residuals(x), loss.weights))
        details = {
            "start": options.start,
            "started_from": watched[0].tolist(),
            "data_rms": float(np.sqrt(np.mean(data**2))),  # in amplitudes
            "physics_rms": float(np.sqrt(np.mean(physics**2))),  # in units of Aω²
        }
        count, outcome = training.evaluations, training.outcome
        return Estimate(self.name, "initial", values, {}, trace, details, evaluations=count, outcome=outcome)


class Collocation(ScaledRecord):
    """The loss of equation (17) as a sum of squares: misfits of the record, of a known start, and of the equation.

    Unknown are the weights of the network, then the physical parameters in units.
    start: the first unknowns. units: of the physical parameters. weights: of data, start and physics in the residuals.
    """

    def __init__(
        self,
        signal: Signal,
        problem: Problem,
        features: Features,
        options: PinnOptions,
        rng: np.random.Generator,
    ) -> None:
        super().__init__(signal, problem, features)
        damping = UNINFORMED / self.ratios
        if options.start == "direct":
            guess = decay_start(problem, features)
            damping = np.array([guess[name] for name in self.coefficients])
        free = np.array([self.base[name] for name in self.restoring])
        self.units = UNIT * np.concatenate([0.1 / self.ratios, np.maximum(np.abs(free), features.amplitude)])
        self.network = DenseNetwork((1 + 2 * options.harmonics, options.width, options.width, 1))
        phase, end = phase_of(signal, features), float(signal.t[-1])

        def inputs(t: np.ndarray) -> np.ndarray:
            """Return time from −1 to 1, sines and cosines of the phase's multiples, as jets in ωt, (3, n, inputs)."""
            angle, rate, change = phase(t), phase.deriv(1)(t) / self.w, phase.deriv(2)(t) / self.w**2
            columns = [
                np.stack([2.0 * t / end - 1.0, np.full_like(t, 2.0 / (end * self.w)), np.zeros_like(t)])
            ]
            for j in range(1, options.harmonics + 1):
                s, c = np.sin(j * angle), np.cos(j * angle)
                columns.append(np.stack([s, j * rate * c, j * change * c - (j * rate) ** 2 * s]))
                columns.append(np.stack([c, -j * rate * s, -j * change * s - (j * rate) ** 2 * c]))
            return np.stack(columns, axis=2)

        self.data = inputs(self.t)[: self.order + 1]
        # Evenly spread but at no fixed phase, so that friction's effect within a cycle is sampled everywhere.
        count = options.collocation
        self.inside = inputs(end * (np.arange(count) + rng.uniform(0.0, 1.0, count)) / count)
        self.first = inputs(np.zeros(1))[:2]
        weights = self.network.fitted(self.network.draw(rng), self.data, self.y)
        self.start = np.concatenate([weights, np.concatenate([damping, free]) / self.units])
        squares = (1.0 / self.y.size, options.start_weight, options.physics_weight / count)
        self.weights = tuple(square**0.5 for square in squares)

    def physical(self, x: np.ndarray) -> np.ndarray:
        """Return the damping coefficients and free restoring parameters, in SI units."""
        return x[self.network.count :] * self.units

    def residuals(self, x: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the weighted residuals of data, start and physics."""
        return tuple(weight * part for weight, part in zip(self.weights, self._parts(x)[:3]))

    def linearise(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the weighted residuals (n,) and their Jacobian by the unknowns."""
        *parts, shares, by_physical = self._parts(x)
        weights, of_network = x[: self.network.count], self.network.count
        of_data, of_start, of_physics = self.weights
        residuals = np.concatenate([weight * part for weight, part in zip(self.weights, parts)])
        jacobian = np.zeros((residuals.size, x.size))
        last = np.zeros((self.order + 1, self.y.size))
        last[-1] = of_data
        jacobian[: self.y.size, :of_network] = self.network.slopes(weights, self.data, last)
        for row, which in enumerate(self.given, self.y.size):
            own = of_start * np.eye(2)[which, :, None]
            jacobian[row, :of_network] = self.network.slopes(weights, self.first, own)[0]
        physics = jacobian[-shares.shape[1] :]
        physics[:, :of_network] = self.network.slopes(weights, self.inside, of_physics * shares)
        physics[:, of_network:] = of_physics * by_physical
        return residuals, jacobian

    def _parts(self, x: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the residuals of data, start and physics, in Aω², and the derivatives of the last.

        These are by the network's jet, (3, n), and by the physical unknowns, (n, k).
        """
        a, w, weights = self.a, self.w, x[: self.network.count]
        data = self.network.jets(weights, self.data)[-1] - self.y
        begin = self.network.jets(weights, self.first)[self.given, 0] - self.begin
        angle, velocity, acceleration = self.network.jets(weights, self.inside)
        damping, restoring = np.split(self.physical(x), [len(self.coefficients)])
        theta, scale = self.rest + a * angle, 1.0 / (a * w * w)
        force, (slope, by) = self.restoring_force(theta, restoring), self.restoring_slopes(theta, restoring)
        shape, steep = self.damping_shapes(a * w * velocity)
        return (
            data,
            begin,
            acceleration + scale * (force + shape @ damping),
            np.stack([scale * a * slope, scale * a * w * (steep @ damping), np.ones_like(angle)]),
            scale * np.concatenate([shape, by], axis=1) * self.units,
        )


PLUGIN = Pinn()
