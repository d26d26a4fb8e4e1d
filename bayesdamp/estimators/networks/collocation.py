"""Compute the loss of a physics-informed neural network as a sum of squares, and train the network.

The loss is equation 17 of the paper that `bayesdamp.estimators` cites.
"""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from bayesdamp.estimators.networks.training import (
    DenseNetwork,
    Evaluated,
    ScaledRecord,
    descend,
    jacobian,
    single_thread,
    train,
)
from bayesdamp.estimators.shared import decay_start, free_start, phase_of
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

UNIT = 3.0
"""Factor that enlarges the units of the physical parameters in the training. The larger it is, the less Levenberg's
method limits their steps compared with those of the network's weights."""
UNINFORMED = 0.05
"""Equivalent damping ratio of each term from which the training starts with the option start = "uninformed"."""
COLLINEAR = 1e-3
"""Fraction of the largest singular value below which singular values are left out when the output layer of the
untrained network is fitted to the record."""


class Collocation(ScaledRecord):
    """Compute the residuals whose sum of squares is the loss of a physics-informed network for the motion.

    They are the misfits of the record, of a known start, and of the equation of motion at many instants. The unknowns
    are the weights of the network, then the physical parameters divided by `units`: the damping coefficients, then the
    unknown restoring parameters. The methods take them as a vector x (k,), or as one row for each misfit, (n, k).
    first: start values of the unknowns, (k,). units: units of the physical parameters.
    """

    def __init__(
        self, signal: Signal, problem: Problem, features: Features, rng: np.random.Generator, options: Any
    ) -> None:
        super().__init__(signal, problem, features)
        damping = UNINFORMED / self.ratios
        if options.start == "direct":
            guess = decay_start(problem, features)
            damping = np.array([guess[name] for name in self.coefficients])
        free = np.array([self.base[name] for name in self.restoring])
        self.units = UNIT * np.concatenate([0.1 / self.ratios, np.maximum(np.abs(free), self.a)])
        harmonics, collocation = options.harmonics, options.collocation
        self.network = DenseNetwork((1 + 2 * harmonics, options.width, options.width, 1))
        self.physics_weight, self.start_weight = options.physics_weight, options.start_weight
        phase, end = phase_of(signal, features), float(signal.t[-1])

        def input_jets(t: np.ndarray, order: int) -> Tensor:
            """Return the inputs at times t (n,), and their derivatives by ωt up to `order`, (n, 1 + order, inputs).

            The inputs are time, scaled to −1 to 1, and sines and cosines of multiples of the phase. t: in s.
            """
            multiples = np.arange(1.0, harmonics + 1)
            angle, rate, bend = (phase.deriv(k)(t)[:, None] * multiples / self.w**k for k in range(3))
            waves = np.exp(1j * angle)
            jets = [waves, 1j * rate * waves, (1j * bend - rate**2) * waves][: order + 1]
            times = [2.0 * t / end - 1.0, np.full(t.size, 2.0 / (end * self.w)), np.zeros(t.size)]
            rows = [np.column_stack([time, wave.imag, wave.real]) for time, wave in zip(times, jets)]
            return torch.from_numpy(np.stack(rows, axis=1))

        self.data_inputs, self.begin_inputs = input_jets(self.t, self.order), input_jets(np.zeros(2), 1)
        # Evenly spread but at no fixed phase, so that friction's effect within a cycle is sampled everywhere.
        instants = end * (np.arange(collocation) + rng.uniform(0.0, 1.0, collocation)) / collocation
        self.physics_inputs = input_jets(instants, 2)
        self.misfits = ((self.data, self.y.numel()), (self.begin, 2), (self.physics, collocation))

        weights = self.network.draw(rng)
        last = self.network.last_hidden(weights, self.data_inputs)[:, -1]
        ones = np.full(self.y.numel(), float(self.order == 0))
        output = np.linalg.lstsq(np.column_stack([last, ones]), self.y.numpy(), rcond=COLLINEAR)[0]
        physical = np.concatenate([damping, free]) / self.units
        self.first = np.concatenate([weights[: -output.size].numpy(), output, physical])

    def data(self, x: Tensor) -> Tensor:
        """Return the network's misfits at the n samples, (n,), divided by √n.

        A misfit is predicted minus recorded quantity, in units of Aωᵏ, with the record's amplitude A, its angular
        frequency ω, and the order k of the recorded derivative. x: the unknowns, (k,), or one row for each misfit.
        """
        return (self.motion(x, self.data_inputs)[:, -1] - self.y) / self.y.numel() ** 0.5

    def begin(self, x: Tensor) -> Tensor:
        """Return the network's weighted misfits of angle and velocity at the start, (2,); 0 for unknown values.

        They are in units of the record's amplitude A, and of Aω with its angular frequency ω, times the square root of
        the option `start_weight`. x: the unknowns, (k,), or one row for each misfit.
        """
        motion = self.motion(x, self.begin_inputs).diagonal()
        return self.start_weight**0.5 * self.is_given * (motion - self.known_begin)

    def physics(self, x: Tensor) -> Tensor:
        """Return the weighted residuals of the equation of motion at the n collocation instants, (n,).

        The unit is Aω², with the record's amplitude A and angular frequency ω. Their sum of squares is the option
        `physics_weight` times the mean square residual. x: the unknowns, (k,), or one row for each residual.
        """
        angle, velocity, acceleration = self.motion(x, self.physics_inputs).unbind(1)
        physical = x.split([self.network.count, self.units.size], dim=-1)[1] * torch.from_numpy(self.units)
        damping, restoring = physical.tensor_split([len(self.coefficients)], dim=-1)
        force = self.restoring_force(self.rest + self.a * angle, restoring)
        force = force + (self.damping_shapes(self.a * self.w * velocity) * damping).sum(-1)
        return (self.physics_weight / angle.numel()) ** 0.5 * (acceleration + force / (self.a * self.w**2))

    def motion(self, x: Tensor, inputs: Tensor) -> Tensor:
        """Return the network's output: the angle from the equilibrium and its first j − 1 time derivatives, (n, j).

        It is the motion in the physics-informed estimator. The derivative of order k is in units of Aωᵏ, with the
        record's amplitude A and angular frequency ω. x: the unknowns, (k,), or one row for each of the n times; only
        the weights are used. inputs: the network's inputs and their derivatives by ωt, (n, j, inputs).
        """
        weights, _ = x.split([self.network.count, self.units.size], dim=-1)
        return self.network.output(weights, inputs)

    def evaluate(self, x: np.ndarray) -> Evaluated:
        """Return the misfits of record, start and equation of motion, (n,), in this order, for the unknowns x (k,).

        The second result is a function that computes their Jacobian by the unknowns, (n, k).
        """
        unknowns = torch.from_numpy(x)

        def derive() -> np.ndarray:
            slopes = [jacobian(misfit, unknowns.expand(rows, -1))[1] for misfit, rows in self.misfits]
            return torch.cat(slopes).numpy()

        with torch.no_grad():
            return torch.cat([misfit(unknowns) for misfit, _ in self.misfits]).numpy(), derive


@single_thread()
def estimate(
    signal: Signal, problem: Problem, features: Features, rng: np.random.Generator, options: Any
) -> Estimate:
    """Train a network together with the physical parameters; return these as the estimate, without standard errors.

    An unknown start is that of the trained network. The outcome is a sentence if the training did not converge.

    Parameters
    ----------
    signal, problem, features
        The record, its damping terms and known parameters, and its features.
    rng
        Random generator for the first weights and the instants.
    options
        Options of the estimator, `PinnOptions`.

    Raises
    ------
    Refusal
        If the loss is not finite.
    """
    loss = Collocation(signal, problem, features, rng, options)
    count, last = loss.network.count, loss.network.count + len(loss.coefficients)
    training = train(descend(loss.evaluate, loss.first), options.rounds, lambda x: x[count:last])
    if not np.isfinite(training.loss):
        raise Refusal("the training of the network gave numbers that are not finite")
    values = dict(zip((*loss.coefficients, *loss.restoring), (training.x[count:] * loss.units).tolist()))
    x = torch.from_numpy(training.x)
    angle, velocity = loss.motion(x, loss.begin_inputs)[0].tolist()
    values |= free_start(problem, loss.rest + loss.a * angle, loss.a * loss.w * velocity)
    return Estimate("pinn", "initial", values, evaluations=training.evaluations, outcome=training.outcome)
