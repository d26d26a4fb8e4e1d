"""The loss of a physics-informed neural network (paper, equation 17) as a sum of squares."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from bayesdamp.estimators.networks.record import Phase, ScaledRecord
from bayesdamp.estimators.networks.training import REAL, generator, jets, layers, slopes
from bayesdamp.estimators.shared import decay_start
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Problem, Signal

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

        phase, end = Phase(signal, features), float(signal.t[-1])
        step = 2.0 / (end * self.w)

        def inputs(t: np.ndarray) -> Tensor:
            """Return time from −1 to 1, sines and cosines of the phase's multiples, as jets in ωt, (n, 3, inputs)."""
            angle, rate, change = phase.jet(t)
            rate, change = rate / self.w, change / self.w**2
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

    def scaled_damping(self, x: Tensor) -> np.ndarray:
        """Return the damping coefficients in units."""
        return x[self.count : self.count + len(self.coefficients)].numpy()

    def start_of(self, x: Tensor) -> tuple[float, float]:
        """Return the network's θ(0) and θ̇(0)."""
        n, n1 = jets(x[: self.count], self.first, self.sizes)[0].tolist()
        return self.rest + self.a * n, self.a * self.w * n1

    def _physics(self, jet: Tensor, x: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return the residual (m,) in Aω², and its derivatives by N, by N', by the physical unknowns."""
        a, w = self.a, self.w
        values, c = self.physical(x), len(self.coefficients)
        theta, omega = (self.rest + a * jet[:, 0]).numpy(), (a * w * jet[:, 1]).numpy()
        force, slope, by = self.restoring_force(theta, values[c:])
        shape, steep = self.damping_shapes(omega)
        scale = 1.0 / (a * w * w)
        return (
            jet[:, 2] + scale * torch.from_numpy(force + shape @ values[:c]),
            torch.from_numpy(scale * a * slope),
            torch.from_numpy(scale * a * w * (steep @ values[:c])),
            torch.from_numpy(scale * np.concatenate([shape, by], axis=1) * self.units.numpy()),
        )

    def _parts(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]:
        """Return the residuals of data, start and physics, and the three derivatives of the last."""
        weights = x[: self.count]
        physics = self._physics(jets(weights, self.inside, self.sizes), x)
        data = jets(weights, self.data, self.sizes)[:, self.order] - self.y
        begin = jets(weights, self.first, self.sizes)[0, self.given] - self.begin
        return data, begin, *physics

    def residuals(self, x: Tensor) -> Tensor:
        """Return the weighted residuals (n,)."""
        return torch.cat([weight * part for weight, part in zip(self.weight, self._parts(x)[:3])])

    def misfits(self, x: Tensor) -> dict[str, float]:
        """Return the root mean square of the data's misfit in amplitudes, and of the equation's in units of Aω²."""
        data, _, physics, *_ = self._parts(x)
        return {
            "data_rms": float(data.square().mean().sqrt()),
            "physics_rms": float(physics.square().mean().sqrt()),
        }

    def linearise(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return the weighted residuals (n,) and their Jacobian by the unknowns."""
        weights = x[: self.count]
        *parts, by_angle, by_velocity, by_physical = self._parts(x)
        inside = slopes(weights, self.inside, self.sizes)
        moved = inside[:, 2] + by_angle[:, None] * inside[:, 0] + by_velocity[:, None] * inside[:, 1]
        of_data, of_start, of_physics = self.weight
        outer = torch.cat(
            [
                of_data * slopes(weights, self.data, self.sizes)[:, self.order],
                of_start * slopes(weights, self.first, self.sizes)[0, self.given],
            ]
        )
        none = torch.zeros(outer.shape[0], self.units.numel(), dtype=REAL)
        jacobian = torch.cat(
            [torch.cat([outer, none], dim=1), of_physics * torch.cat([moved, by_physical], dim=1)]
        )
        return torch.cat([weight * part for weight, part in zip(self.weight, parts)]), jacobian
