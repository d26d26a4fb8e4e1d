"""Physics-informed neural network (paper, section 3.5, equations 17 to 19).

θ(t) is a network whose inputs are time and the sines and cosines of the record's own phase and its harmonics; angles
are in amplitudes and the residual of the equation of motion in units of Aω². Damping coefficients are trained along
with the weights. Time derivatives are carried through the network by hand, and the loss, a sum of squares, is
lowered by Levenberg–Marquardt steps.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.networks.jets import jets, slopes
from bayesdamp.estimators.networks.record import Phase, Scaled
from bayesdamp.estimators.networks.training import (
    REAL,
    gauss_newton,
    generator,
    layers,
    single_thread,
)
from bayesdamp.estimators.shared import (
    checked_features,
    decay_start,
    free_start,
    oscillator,
)
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

UNINFORMED = 0.05
"""Equivalent damping ratio of each term at an uninformed start."""


class PinnOptions(Options):
    """start: damping at an equivalent ratio of 0.05, whatever the record, or from its loss of energy.

    width: units in each of the two hidden layers. harmonics: of the record's frequency among the inputs.
    collocation: instants at which the equation of motion is asked for.
    physics_weight, start_weight: λ1 and λ2 of equation (17). rounds: training steps at most.
    """

    start: Literal["uninformed", "direct"] = "uninformed"
    width: int = Field(default=20, ge=4, le=64)
    harmonics: int = Field(default=3, ge=1, le=10)
    collocation: int = Field(default=500, ge=50, le=5000)
    physics_weight: float = Field(default=10.0, gt=0.0)
    start_weight: float = Field(default=10.0, ge=0.0)
    rounds: int = Field(default=300, ge=1, le=5000)


class Pinn(Estimator[PinnOptions]):
    """Damping coefficients, and free restoring parameters, of a network trained on record and equation of motion.

    A coefficient may come out negative: it is reported as it is.
    """

    by_position = "the damping in its loss is a function of the velocity alone"
    with_parameters = "its loss has one weight for each term"
    options = PinnOptions

    def initial(
        self, signal: Signal, problem: Problem, options: PinnOptions, rng: np.random.Generator
    ) -> Estimate:
        """Coefficients that were trained with a network for the motion, by its residual in the equation."""
        seen = checked_features(signal)
        with single_thread():
            loss = _Loss(signal, problem, options, seen, rng)
            trained = gauss_newton(loss.residuals, loss.linearised, loss.start, options.rounds, loss.sought)
        if not np.all(np.isfinite(trained.losses)):
            raise Refusal("the network's training came to numbers that are not finite")
        names = (*loss.coefficients, *loss.restoring)
        watched = trained.watched * loss.units.numpy()[: len(loss.coefficients)]
        found = dict(zip(names, map(float, loss.physical(trained.x))))
        found |= free_start(problem, *loss.beginning(trained.x))
        return Estimate(
            self.name,
            "initial",
            found,
            trace={"loss": trained.losses, **dict(zip(loss.coefficients, watched.T))},
            details={
                "start": options.start,
                "started_from": [float(value) for value in watched[0]],
                **loss.parts(trained.x),
            },
            evaluations=trained.evaluations,
            outcome=trained.outcome,
        )


class _Loss(Scaled):
    """Equation (17) as a sum of squares; unknown are the weights, then the physical parameters in units.

    start: the first unknowns. coefficients, restoring: names of the physical ones.
    """

    def __init__(
        self, signal: Signal, problem: Problem, options: PinnOptions, seen: Features, rng: np.random.Generator
    ) -> None:
        super().__init__(signal, problem, seen)
        per_ratio = [1.0 / term.ratio_per_unit(self.a, self.w) for term in oscillator(problem).terms]
        guess = decay_start(problem, seen)
        direct = [guess[name] for name in self.coefficients]
        damping = direct if options.start == "direct" else [UNINFORMED * unit for unit in per_ratio]
        free = [self.base[name] for name in self.restoring]
        self.units = torch.tensor(
            [0.1 * unit for unit in per_ratio] + [max(abs(v), seen.amplitude) for v in free], dtype=REAL
        )
        physical = torch.tensor([*damping, *free], dtype=REAL) / self.units

        self.sizes = (1 + 2 * options.harmonics, options.width, options.width, 1)
        weights = layers(self.sizes, generator(rng), bias=0.5)
        self.count = weights.numel()
        self.start = torch.cat([weights, physical])

        phase, end = Phase(signal, seen), float(signal.t[-1])

        def rows(t: np.ndarray) -> Tensor:
            return _inputs(t, end, phase, options.harmonics, seen.frequency)

        self.data = rows(self.t)[:, : self.order + 1]
        # Evenly spread but at no fixed phase, so that what friction does within a cycle is seen everywhere.
        spread = (
            np.arange(options.collocation) + rng.uniform(0.0, 1.0, options.collocation)
        ) / options.collocation
        self.inside = rows(end * spread)
        self.first = rows(np.zeros(1))[:, :2]
        self.weight = (
            1.0 / self.y.numel() ** 0.5,
            (options.physics_weight / options.collocation) ** 0.5,
            options.start_weight**0.5,
        )

    def physical(self, x: Tensor) -> np.ndarray:
        """Damping coefficients and free restoring parameters, in SI units."""
        return (x[self.count :] * self.units).numpy()

    def sought(self, x: Tensor) -> np.ndarray:
        """Damping coefficients in units."""
        return x[self.count : self.count + len(self.coefficients)].numpy()

    def beginning(self, x: Tensor) -> tuple[float, float]:
        """The network's θ(0) and θ̇(0)."""
        n, n1 = jets(x[: self.count], self.first, self.sizes)[0].tolist()
        return self.rest + self.a * n, self.a * self.w * n1

    def _physics(self, jet: Tensor, x: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Residual (m,) in Aω², and its derivatives by N, by N', by the physical unknowns."""
        a, w = self.a, self.w
        values, c = self.physical(x), len(self.coefficients)
        theta, omega = (self.rest + a * jet[:, 0]).numpy(), (a * w * jet[:, 1]).numpy()
        force, slope, by = self.forces.restoring(theta, values[c:])
        shape, steep = self.forces.shapes(omega)
        scale = 1.0 / (a * w * w)
        total = jet[:, 2] + scale * torch.from_numpy(force + shape @ values[:c])
        units = self.units.numpy()
        return (
            total,
            torch.from_numpy(scale * a * slope),
            torch.from_numpy(scale * a * w * (steep @ values[:c])),
            torch.from_numpy(scale * np.concatenate([shape, by], axis=1) * units),
        )

    def _joined(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor, tuple[Tensor, Tensor, Tensor]]:
        """Residuals of data, start and physics, and the derivatives of the last."""
        weights = x[: self.count]
        physics, *by = self._physics(jets(weights, self.inside, self.sizes), x)
        data = jets(weights, self.data, self.sizes)[:, self.order] - self.y
        begin = jets(weights, self.first, self.sizes)[0, self.given] - self.begin
        return data, begin, physics, tuple(by)  # type: ignore[return-value]

    def residuals(self, x: Tensor) -> Tensor:
        """Weighted residuals (n,)."""
        data, begin, physics, _ = self._joined(x)
        return torch.cat([self.weight[0] * data, self.weight[2] * begin, self.weight[1] * physics])

    def parts(self, x: Tensor) -> dict[str, float]:
        """Root mean square of the data's misfit in amplitudes, and of the equation's in units of Aω²."""
        data, _, physics, _ = self._joined(x)
        return {
            "data_rms": float(data.square().mean().sqrt()),
            "physics_rms": float(physics.square().mean().sqrt()),
        }

    def linearised(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Weighted residuals (n,) and their Jacobian by the unknowns."""
        weights = x[: self.count]
        data, begin, physics, (by_angle, by_velocity, by_physical) = self._joined(x)
        inside = slopes(weights, self.inside, self.sizes)
        moved = inside[:, 2] + by_angle[:, None] * inside[:, 0] + by_velocity[:, None] * inside[:, 1]
        none = torch.zeros(data.numel() + begin.numel(), self.units.numel(), dtype=REAL)
        outer = torch.cat(
            [
                self.weight[0] * slopes(weights, self.data, self.sizes)[:, self.order],
                self.weight[2] * slopes(weights, self.first, self.sizes)[0, self.given],
            ]
        )
        jacobian = torch.cat(
            [torch.cat([outer, none], dim=1), self.weight[1] * torch.cat([moved, by_physical], dim=1)]
        )
        return torch.cat([self.weight[0] * data, self.weight[2] * begin, self.weight[1] * physics]), jacobian


def _inputs(t: np.ndarray, end: float, phase: Phase, harmonics: int, frequency: float) -> Tensor:
    """Time from −1 to 1, sines and cosines of the phase's multiples, with derivatives by ωt, (n, 3, inputs)."""
    angle, rate, change = phase.jet(t)
    rate, change = rate / frequency, change / frequency**2
    step = 2.0 / (end * frequency)
    columns = [np.stack([2.0 * t / end - 1.0, np.full_like(t, step), np.zeros_like(t)], axis=1)]
    for j in range(1, harmonics + 1):
        s, c = np.sin(j * angle), np.cos(j * angle)
        columns.append(np.stack([s, j * rate * c, j * change * c - (j * rate) ** 2 * s], axis=1))
        columns.append(np.stack([c, -j * rate * s, -j * change * s - (j * rate) ** 2 * c], axis=1))
    return torch.from_numpy(np.stack(columns, axis=2))


PLUGIN = Pinn()
