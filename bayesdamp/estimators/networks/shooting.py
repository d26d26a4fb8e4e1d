"""Multiple shooting: segments of a record integrated in one batch, with their sensitivities."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.polynomial import Polynomial
from torch import Tensor
from torchdiffeq import odeint

from bayesdamp.estimators.networks.record import ScaledRecord
from bayesdamp.estimators.networks.training import (
    REAL,
    gauss_newton,
    generator,
    jets,
    layers,
    single_thread,
    slopes,
)
from bayesdamp.estimators.shared import free_start
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

MOST_SEGMENTS = 160
GRID = 41
"""Velocities at which the learnt force is reported."""
QUINTIC = np.array(
    [
        [1.0, 0.0, 0.0, -10.0, 15.0, -6.0],
        [0.0, 1.0, 0.0, -6.0, 8.0, -3.0],
        [0.0, 0.0, 0.5, -1.5, 1.5, -0.5],
        [0.0, 0.0, 0.0, 10.0, -15.0, 6.0],
        [0.0, 0.0, 0.0, -4.0, 7.0, -3.0],
        [0.0, 0.0, 0.0, 0.5, -1.0, 0.5],
    ]
)
"""Powers 0 to 5 of the share of a step, in the polynomials of value, slope and curvature at either end."""


class Shooting(ScaledRecord):
    """The loss of a learnt damping force as a sum of squares.

    Angles are in amplitudes A about the rest, times in 1/ω, forces in Aω². Unknown are the weights of the network, the
    free restoring parameters in units, and each segment's first angle and velocity.
    start: the first unknowns. units: of the coefficients. peak: the largest velocity, rad/s.
    """

    def __init__(
        self,
        signal: Signal,
        problem: Problem,
        features: Features,
        *,
        width: int,
        steps: int,
        continuity_weight: float,
        random: torch.Generator,
    ) -> None:
        super().__init__(signal, problem, features)
        self.units = 0.1 / self.ratios
        free = np.array([self.base[name] for name in self.restoring])
        self.free_units = np.maximum(np.abs(free), self.a)

        self.sizes = (1, width, width, 1)
        weights = layers(self.sizes, random, bias=0.5)
        self.count = weights.numel()
        decay = np.log(max(features.amplitude / features.final_amplitude, 1.05)) / (self.w * signal.t[-1])
        self.force_unit = 2.0 * decay

        end = float(signal.t[-1]) * self.w
        self.segments = int(np.clip(round(end / np.pi), 2, MOST_SEGMENTS))
        length = end / self.segments
        intervals = max(8, int(np.ceil(steps * length / (2 * np.pi))))
        self.nodes = torch.linspace(0.0, length, intervals + 1, dtype=REAL)

        # Each sample's segment, its step in there, and the weights of the nodes on either side.
        s, step = self.t * self.w, float(self.nodes[1])
        interval = np.clip((s / step).astype(int), 0, self.segments * intervals - 1)
        self.segment = torch.from_numpy(interval // intervals)
        self.step = torch.from_numpy(interval % intervals)
        ends = [Polynomial(c).deriv(self.order) if self.order else Polynomial(c) for c in QUINTIC]
        scale = step ** (np.array([0, 1, 2, 0, 1, 2]) - float(self.order))
        dense = np.stack([end(s / step - interval) for end in ends], axis=1) * scale
        self.dense = torch.from_numpy(dense).reshape(-1, 2, 3)

        self.weight = (1.0 / self.t.size**0.5, continuity_weight)
        states, y = [], self.recorded / (self.a * self.w**self.order)
        for i in range(self.segments):  # angle and velocity of a sinusoid that is fitted near its start
            tau = s - i * length
            near = np.argsort(np.abs(tau), kind="stable")
            near = near[: max(8, int(np.count_nonzero(np.abs(tau) < 0.75 * np.pi)))]
            columns = np.stack([np.cos(tau[near]), np.sin(tau[near]), np.ones(near.size)], axis=1)
            c, d, middle = np.linalg.lstsq(columns, y[near], rcond=1e-6)[0]
            at_rest = (middle - self.rest / self.a) if self.order == 0 else 0.0
            states.append([(c + at_rest, d), (-d, c), (-c, -d)][self.order])
        states = torch.tensor(states, dtype=REAL)
        self.start = torch.cat([weights, torch.tensor(free / self.free_units, dtype=REAL), states.flatten()])
        self.physical = self.count + free.size
        self.peak = float(self.a * self.w * states[:, 1].abs().max())

    def _force(self, x: Tensor, v: Tensor) -> tuple[Tensor, Tensor]:
        """Return f(v) and its slope, both (n,), in units of Aω²: odd in v."""
        both = torch.cat([v, -v])
        inputs = torch.stack([both, torch.ones_like(both)], dim=1)[:, :, None]
        value, slope = jets(x[: self.count], inputs, self.sizes).unbind(1)
        n = v.numel()
        return self.force_unit * (value[:n] - value[n:]) / 2, self.force_unit * (slope[:n] + slope[n:]) / 2

    def _solve(self, x: Tensor, with_tangents: bool = False) -> tuple[Tensor, Tensor]:
        """Return angle, velocity, acceleration at the nodes (segments, nodes, 3), and their tangents (…, 3, c).

        Tangents are derivatives by the segment's start (2), the weights and the free restoring parameters; c may be 0.
        """
        unit, values = self.a * self.w**2, x[self.count : self.physical].numpy() * self.free_units
        columns = 2 + self.physical if with_tangents else 0
        first = torch.zeros(self.segments, 2, 1 + columns, dtype=REAL)
        first[:, :, 0] = x[self.physical :].reshape(self.segments, 2)
        if with_tangents:
            first[:, 0, 1] = first[:, 1, 2] = 1.0

        def rate(_: Tensor, state: Tensor) -> Tensor:
            """Return the rates, (n, 2, 1 + c), of angle and velocity and their tangents."""
            angle, v, tangents = state[:, 0, 0], state[:, 1, 0], state[:, :, 1:]
            force, slope, by = self.restoring_force((self.rest + self.a * angle).numpy(), values)
            learnt, steep = self._force(x, v)
            acceleration = (-torch.from_numpy(force / unit) - learnt)[:, None]
            if with_tangents:
                stiff = torch.from_numpy(slope / self.w**2)
                moved = -stiff[:, None] * tangents[:, 0] - steep[:, None] * tangents[:, 1]
                by_weights = slopes(x[: self.count], torch.cat([v, -v])[:, None, None], self.sizes)[:, 0]
                n = v.numel()
                moved[:, 2 : 2 + self.count] -= self.force_unit * (by_weights[:n] - by_weights[n:]) / 2
                moved[:, 2 + self.count :] -= torch.from_numpy(by * self.free_units / unit)
                acceleration = torch.cat([acceleration, moved], dim=1)
            return torch.stack([state[:, 1], acceleration], dim=1)

        path = odeint(rate, first, self.nodes, method="rk4").transpose(0, 1)  # type: ignore[union-attr]
        flat = path.reshape(-1, 2, 1 + columns)
        bent = rate(self.nodes[0], flat)[:, 1].reshape(*path.shape[:2], 1, 1 + columns)
        every = torch.cat([path, bent], dim=2)
        return every[..., 0], every[..., 1:]

    def _sampled(self, nodes: Tensor) -> Tensor:
        """Interpolate the nodes' (angle, velocity, acceleration), or their tangents, at the samples."""
        pair = torch.stack([nodes[self.segment, self.step], nodes[self.segment, self.step + 1]], dim=1)
        return torch.einsum("nij,nij...->n...", self.dense, pair)

    def _join(self, x: Tensor, nodes: Tensor) -> Tensor:
        states = x[self.physical :].reshape(self.segments, 2)
        data = self._sampled(nodes) - self.y
        gaps = (nodes[:-1, -1, :2] - states[1:]).reshape(-1)
        begin = states[0, self.given] - self.begin
        return torch.cat([self.weight[0] * data, self.weight[1] * gaps, self.weight[1] * begin])

    def residuals(self, x: Tensor) -> Tensor:
        """Return the weighted misfit of the samples, gaps between segments, misfit of a known start, (n,)."""
        return self._join(x, self._solve(x)[0])

    def linearise(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return `residuals` (n,), and their Jacobian by the unknowns."""
        nodes, tangents = self._solve(x, with_tangents=True)
        r = self._join(x, nodes)
        jacobian = torch.zeros(r.numel(), x.numel(), dtype=REAL)
        n, gaps = self.y.numel(), 2 * (self.segments - 1)
        local = self.weight[0] * self._sampled(tangents)
        jacobian[:n, : self.physical] = local[:, 2:]
        rows = torch.arange(n)
        ends = self.weight[1] * tangents[:-1, -1, :2].reshape(gaps, -1)
        jacobian[n : n + gaps, : self.physical] = ends[:, 2:]
        joins = torch.arange(gaps)
        for j in range(2):
            jacobian[rows, self.physical + 2 * self.segment + j] = local[:, j]
            jacobian[n + joins, self.physical + 2 * (joins // 2) + j] = ends[:, j]
        jacobian[n + joins, self.physical + 2 + joins] = -self.weight[1]
        for i, which in enumerate(self.given):
            jacobian[n + gaps + i, self.physical + which] = self.weight[1]
        return r, jacobian

    def force(self, x: Tensor, velocity: np.ndarray) -> np.ndarray:
        """Return the learnt force, rad/s², at velocities in rad/s, (n,)."""
        learnt, _ = self._force(x, torch.from_numpy(velocity / (self.a * self.w)))
        return (learnt * self.a * self.w**2).numpy()

    def project(self, x: Tensor) -> np.ndarray:
        """Project the learnt force on the damping terms; coefficients (terms,) in units.

        The law takes the same power as the learnt force in each segment, by least squares.
        """
        velocity = (self._solve(x)[0][..., 1] * self.a * self.w).numpy()
        flat = velocity.reshape(-1)
        shapes = self.damping_shapes(flat)[0] * self.units
        if not np.all(np.isfinite(flat)):
            return np.full(self.units.size, np.nan)
        power = (flat * self.force(x, flat)).reshape(velocity.shape).mean(axis=1)
        of_law = (flat[:, None] * shapes).reshape(*velocity.shape, -1).mean(axis=1)
        return np.linalg.lstsq(of_law, power, rcond=None)[0]


@single_thread()
@torch.no_grad()
def train(
    signal: Signal,
    problem: Problem,
    features: Features,
    rng: np.random.Generator,
    *,
    rounds: int,
    **settings: Any,
) -> Estimate:
    """Train a network for the damping force, and project it on the damping terms.

    Parameters
    ----------
    signal, problem, features
        The record, what is known of its system, and what the record shows.
    rng
        Random numbers of the first weights.
    rounds
        Largest number of training steps.
    settings
        As `Shooting` takes them.

    Raises
    ------
    Refusal
        If the training comes to trajectories that are not finite.
    """
    loss = Shooting(signal, problem, features, random=generator(rng), **settings)
    training = gauss_newton(loss.residuals, loss.linearise, loss.start, rounds, loss.project, steady=1e-3)
    if not np.all(np.isfinite(training.watched)):
        raise Refusal("the training came to trajectories that are not finite")
    x, coefficients = training.x, training.watched * loss.units
    values = dict(zip(loss.coefficients, map(float, coefficients[-1])))
    values |= dict(zip(loss.restoring, map(float, x[loss.count : loss.physical].numpy() * loss.free_units)))
    angle, velocity = x[loss.physical : loss.physical + 2].tolist()
    values |= free_start(problem, loss.rest + loss.a * angle, loss.a * loss.w * velocity)
    grid = np.linspace(-loss.peak, loss.peak, GRID)
    details = {
        "velocity": grid.tolist(),
        "force": loss.force(x, grid).tolist(),
        "law": (loss.damping_shapes(grid)[0] @ coefficients[-1]).tolist(),
    }
    trace = {"loss": training.losses, **dict(zip(loss.coefficients, coefficients.T))}
    count, outcome = training.evaluations, training.outcome
    return Estimate("neural_ode", "initial", values, {}, trace, details, evaluations=count, outcome=outcome)
