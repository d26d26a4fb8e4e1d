"""The loss of a physics-informed neural network (paper, equation 17) as a sum of squares."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from bayesdamp.estimators.networks.record import ScaledRecord, phase_of
from bayesdamp.estimators.networks.training import (
    REAL,
    gauss_newton,
    generator,
    jets,
    layers,
    single_thread,
    slopes,
)
from bayesdamp.estimators.shared import decay_start, free_start
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

UNINFORMED = 0.05
"""Equivalent damping ratio of each term at an uninformed start."""


class Collocation(ScaledRecord):
    """Misfits of the record, of a known start, and of the equation of motion at many instants.

    Unknown are the weights of the network, then the physical parameters in units.
    start: the first unknowns. coefficients, restoring: names of the physical parameters.
    """

    def __init__(
        self,
        signal: Signal,
        problem: Problem,
        features: Features,
        rng: np.random.Generator,
        *,
        start: str,
        width: int,
        harmonics: int,
        collocation: int,
        physics_weight: float,
        start_weight: float,
    ) -> None:
        super().__init__(signal, problem, features)
        per_ratio = [1.0 / ratio for ratio in self.ratios]
        damping = [UNINFORMED * unit for unit in per_ratio]
        if start == "direct":
            guess = decay_start(problem, features)
            damping = [guess[name] for name in self.coefficients]
        free = [self.base[name] for name in self.restoring]
        self.units = torch.tensor(
            [0.1 * unit for unit in per_ratio] + [max(abs(v), features.amplitude) for v in free], dtype=REAL
        )
        physical = torch.tensor([*damping, *free], dtype=REAL) / self.units

        self.sizes = (1 + 2 * harmonics, width, width, 1)
        weights = layers(self.sizes, generator(rng), bias=0.5)
        self.count = weights.numel()
        self.start = torch.cat([weights, physical])

        phase, end = phase_of(signal, features), float(signal.t[-1])
        step = 2.0 / (end * self.w)

        def inputs(t: np.ndarray) -> Tensor:
            """Return time from −1 to 1, sines and cosines of the phase's multiples, as jets in ωt, (n, 3, inputs)."""
            angle, rate, change = phase(t), phase.deriv(1)(t) / self.w, phase.deriv(2)(t) / self.w**2
            columns = [np.stack([2.0 * t / end - 1.0, np.full_like(t, step), np.zeros_like(t)], axis=1)]
            for j in range(1, harmonics + 1):
                s, c = np.sin(j * angle), np.cos(j * angle)
                columns.append(np.stack([s, j * rate * c, j * change * c - (j * rate) ** 2 * s], axis=1))
                columns.append(np.stack([c, -j * rate * s, -j * change * s - (j * rate) ** 2 * c], axis=1))
            return torch.from_numpy(np.stack(columns, axis=2))

        self.data = inputs(self.t)[:, : self.order + 1]
        # Evenly spread but at no fixed phase, so that friction's effect within a cycle is sampled everywhere.
        spread = (np.arange(collocation) + rng.uniform(0.0, 1.0, collocation)) / collocation
        self.inside = inputs(end * spread)
        self.first = inputs(np.zeros(1))[:, :2]
        of_data, of_physics = 1.0 / self.y.numel() ** 0.5, (physics_weight / collocation) ** 0.5
        self.weight = (of_data, start_weight**0.5, of_physics)

    def physical(self, x: Tensor) -> np.ndarray:
        """Return the damping coefficients and free restoring parameters, in SI units."""
        return (x[self.count :] * self.units).numpy()

    def parts(self, x: Tensor) -> tuple[Tensor, ...]:
        """Return the residuals of data, start and physics, in Aω², and the derivatives of the last.

        These are by the network's output, by its slope, and by the physical unknowns.
        """
        a, w, weights = self.a, self.w, x[: self.count]
        data = jets(weights, self.data, self.sizes)[:, self.order] - self.y
        begin = jets(weights, self.first, self.sizes)[0, self.given] - self.begin
        jet, scale = jets(weights, self.inside, self.sizes), 1.0 / (a * w * w)
        damping, restoring = np.split(self.physical(x), [len(self.coefficients)])
        force, slope, by = self.restoring_force((self.rest + a * jet[:, 0]).numpy(), restoring)
        shape, steep = self.damping_shapes((a * w * jet[:, 1]).numpy())
        return (
            data,
            begin,
            jet[:, 2] + scale * torch.from_numpy(force + shape @ damping),
            torch.from_numpy(scale * a * slope),
            torch.from_numpy(scale * a * w * (steep @ damping)),
            torch.from_numpy(scale * np.concatenate([shape, by], axis=1) * self.units.numpy()),
        )

    def residuals(self, x: Tensor) -> Tensor:
        """Return the weighted residuals (n,)."""
        return torch.cat([weight * part for weight, part in zip(self.weight, self.parts(x)[:3])])

    def linearise(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return the weighted residuals (n,) and their Jacobian by the unknowns."""
        weights = x[: self.count]
        *parts, by_angle, by_velocity, by_physical = self.parts(x)
        inside = slopes(weights, self.inside, self.sizes)
        moved = inside[:, 2] + by_angle[:, None] * inside[:, 0] + by_velocity[:, None] * inside[:, 1]
        of_data, of_start, of_physics = self.weight
        data = of_data * slopes(weights, self.data, self.sizes)[:, self.order]
        begin = of_start * slopes(weights, self.first, self.sizes)[0, self.given]
        none = torch.zeros(len(data) + len(begin), self.units.numel(), dtype=REAL)
        physics = of_physics * torch.cat([moved, by_physical], dim=1)
        jacobian = torch.cat([torch.cat([torch.cat([data, begin]), none], dim=1), physics])
        return torch.cat([weight * part for weight, part in zip(self.weight, parts)]), jacobian


@single_thread()
def train(
    signal: Signal,
    problem: Problem,
    features: Features,
    rng: np.random.Generator,
    *,
    rounds: int,
    start: str,
    **settings: Any,
) -> Estimate:
    """Train a network together with the physical parameters, which are its estimate.

    Parameters
    ----------
    signal, problem, features
        The record, what is known of its system, and what the record shows.
    rng
        Random numbers of the first weights and of the instants.
    rounds
        Largest number of training steps.
    start, settings
        As `Collocation` takes them.

    Raises
    ------
    Refusal
        If the training comes to numbers that are not finite.
    """
    loss = Collocation(signal, problem, features, rng, start=start, **settings)
    first, last = loss.count, loss.count + len(loss.coefficients)
    training = gauss_newton(
        loss.residuals, loss.linearise, loss.start, rounds, lambda x: x[first:last].numpy()
    )
    if not np.all(np.isfinite(training.losses)):
        raise Refusal("the network's training came to numbers that are not finite")
    x, watched = training.x, training.watched * loss.units.numpy()[: last - first]
    values = dict(zip((*loss.coefficients, *loss.restoring), map(float, loss.physical(x))))
    angle, velocity = jets(x[:first], loss.first, loss.sizes)[0].tolist()
    values |= free_start(problem, loss.rest + loss.a * angle, loss.a * loss.w * velocity)
    trace = {"loss": training.losses, **dict(zip(loss.coefficients, watched.T))}
    data, _, physics, *_ = loss.parts(x)
    details = {
        "start": start,
        "started_from": watched[0].tolist(),
        "data_rms": float(data.square().mean().sqrt()),  # in amplitudes
        "physics_rms": float(physics.square().mean().sqrt()),  # in units of Aω²
    }
    count, outcome = training.evaluations, training.outcome
    return Estimate("pinn", "initial", values, {}, trace, details, evaluations=count, outcome=outcome)
