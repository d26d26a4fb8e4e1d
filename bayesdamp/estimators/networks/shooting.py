"""Train a network for the damping force by multiple shooting: the segments of a record are integrated in one batch."""

from collections.abc import Callable
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor
from torchdiffeq import odeint

from bayesdamp.estimators.networks.training import (
    REAL,
    Evaluated,
    ScaledRecord,
    descend,
    jacobian,
    product,
    single_thread,
    train,
)
from bayesdamp.estimators.shared import free_start
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

MOST_SEGMENTS = 160
"""Largest number of segments into which a record is cut (conventional). A segment is about half a cycle, or longer if
there would be more segments than this; there are at least two."""
GRID = 41
"""Number of velocities, evenly spaced, at which the learnt damping force is reported (conventional)."""
STEADY = 1e-3
"""Training has converged if no damping coefficient has changed by more than this fraction in the last
`training.WINDOW` rounds."""


class Shooting(ScaledRecord):
    """The loss of the neural ODE, whose damping force is learnt, as a sum of squares.

    The damping force is a network. Multiple shooting integrates the motion separately in short segments of the record.
    Angles are measured from the equilibrium in units of the record's amplitude A, times in 1/ω with its angular
    frequency ω, forces in Aω². The unknowns x (k,) are the weights of the network, the unknown restoring parameters
    (divided by `free_units`), and each segment's first angle and velocity. first: start values of the unknowns, (k,).
    units: units in which `project` returns the damping coefficients. width: number of units in each of the two hidden
    layers. count: number of weights. physical: number of weights and restoring parameters, so that the starts of the
    segments begin at this index of x.
    """

    def __init__(
        self, signal: Signal, problem: Problem, features: Features, rng: np.random.Generator, options: Any
    ) -> None:
        super().__init__(signal, problem, features)
        self.units = 0.1 / self.ratios
        free = np.array([self.base[name] for name in self.restoring])
        self.free_units = torch.from_numpy(np.maximum(np.abs(free), self.a))
        self.width = width = options.width
        self.count = width * (width + 2)
        self.physical = self.count + free.size
        decay = np.log(max(features.amplitude / features.final_amplitude, 1.05)) / (self.w * signal.t[-1])
        self.force_unit = 2.0 * decay

        end = float(signal.t[-1]) * self.w
        self.segments = int(np.clip(round(end / np.pi), 2, MOST_SEGMENTS))
        length = end / self.segments
        intervals = max(8, int(np.ceil(options.steps * length / (2 * np.pi))))
        self.nodes = torch.linspace(0.0, length, intervals + 1, dtype=REAL)
        # Each sample's segment, the node before it, and the time since then.
        s, step = self.t * self.w, length / intervals
        interval = np.clip((s / step).astype(int), 0, self.segments * intervals - 1)
        self.segment, self.node = (torch.from_numpy(part) for part in np.divmod(interval, intervals))
        self.since = torch.from_numpy(s - interval * step)

        self.weight = (1.0 / self.t.size**0.5, options.continuity_weight)
        states, y = [], self.recorded / (self.a * self.w**self.order)
        for i in range(self.segments):  # angle and velocity of a sinusoid, fitted near the segment's start
            tau = s - i * length
            near = np.argsort(np.abs(tau), kind="stable")
            near = near[: max(8, int(np.count_nonzero(np.abs(tau) < 0.75 * np.pi)))]
            columns = np.stack([np.cos(tau[near]), np.sin(tau[near]), np.ones(near.size)], axis=1)
            c, d, middle = np.linalg.lstsq(columns, y[near], rcond=1e-6)[0]
            at_rest = (middle - self.rest / self.a) if self.order == 0 else 0.0
            states.append([(c + at_rest, d), (-d, c), (-c, -d)][self.order])
        weights = rng.standard_normal(self.count)
        weights[width:] /= width**0.5
        self.first = np.concatenate([weights, free / self.free_units.numpy(), np.ravel(states)])

    def force(self, x: Tensor, velocity: Tensor) -> Tensor:
        """Return the force of the network (n,), in Aω², at velocities (n,), in Aω, for unknowns x (k,), or (n, k).

        A and ω are the record's amplitude and angular frequency. The network has tanh in two hidden layers and no
        biases, so that the force is an odd function of the velocity.
        """
        first, second, last = x[..., : self.count].split([self.width, self.width**2, self.width], dim=-1)
        hidden = torch.tanh(velocity[:, None] * first)
        matrices = second.unflatten(-1, (self.width, self.width))
        hidden = torch.tanh(product(matrices, hidden[:, None])[:, 0])
        return self.force_unit * (hidden * last).sum(-1)

    def paths(self, x: Tensor) -> Tensor:
        """Return angle and velocity at the nodes of each segment, (nodes, segments, 2), for unknowns x (k,).

        The angle is measured from the equilibrium in units of the record's amplitude A, the velocity in Aω with its
        angular frequency ω. The nodes are the ends of the solver's steps.
        """
        starts = x[self.physical :].reshape(self.segments, 2)
        return _runge_kutta(lambda state: self._rate(x, state), starts, self.nodes)

    def _rate(self, x: Tensor, state: Tensor) -> Tensor:
        """Return the time derivatives of the states, (n, 2), per unit of ωt.

        state: angle from the equilibrium in units of A and velocity in units of Aω, (n, 2). A, ω: the record's
        amplitude and angular frequency. x: the scaled unknowns (weights of the network that gives the damping force,
        parameters of the restoring law, starts of the segments, which have no effect here), (k,), or one row for each
        state, (n, k).
        """
        angle, velocity = state.unbind(-1)
        values = x[..., self.count : self.physical] * self.free_units
        restoring = self.restoring_force(self.rest + self.a * angle, values) / (self.a * self.w**2)
        return torch.stack([velocity, -restoring - self.force(x, velocity)], dim=-1)

    def _step(self, x: Tensor, state: Tensor, duration: Tensor) -> Tensor:
        """Return angle and velocity (n, 2) one step after each state (n, 2), in A and Aω.

        A, ω: the record's amplitude and angular frequency. x: the unknowns, (k,), or one row for each state, (n, k).
        duration (n,): duration of each step, in 1/ω.
        """
        ends = torch.tensor([0.0, 1.0], dtype=REAL)
        return _runge_kutta(lambda state: duration[:, None] * self._rate(x, state), state, ends)[1]

    def _sampled(self, x: Tensor, state: Tensor) -> Tensor:
        """Return the recorded quantity (n,) at each sample, in Aωʲ, where j is the order of the recorded derivative.

        A, ω: the record's amplitude and angular frequency. x: the unknowns, (k,), or one row for each sample, (n, k).
        state: angle and velocity at the node before each sample, (n, 2), in A and Aω.
        """
        state = self._step(x, state, self.since)
        return state[:, self.order] if self.order < 2 else self._rate(x, state)[:, 1]

    def evaluate(self, x: np.ndarray) -> Evaluated:
        """Return the weighted residuals (n,): of the samples, of the jumps between segments, and of a known start.

        A jump is the state at the end of a segment minus the start of the next one. The residuals of unknown start
        values are 0. The sum of squares is the mean square misfit of the samples plus the squared option
        `continuity_weight` times the squares of the others. The second result is a function that computes the Jacobian
        by the unknowns x (k,), (n, k).
        """
        unknowns = torch.from_numpy(x)
        with torch.no_grad():
            paths = self.paths(unknowns)
            sampled = self._sampled(unknowns, paths[self.node, self.segment])
        states = unknowns[self.physical :].reshape(self.segments, 2)
        gaps = (paths[-1, :-1] - states[1:]).flatten()
        begin = self.is_given * (states[0] - self.known_begin)
        misfits = [self.weight[0] * (sampled - self.y), self.weight[1] * gaps, self.weight[1] * begin]
        return torch.cat(misfits).numpy(), lambda: self._slopes(unknowns, paths)

    def _slopes(self, unknowns: Tensor, paths: Tensor) -> np.ndarray:
        """Return the Jacobian (n, k) of the residuals of `evaluate` by the unknowns.

        paths: result of `paths` for these unknowns. The derivatives of all single steps are computed by automatic
        differentiation, in one batch. Those of a path follow from them step by step, by the chain rule.
        """
        steps, columns = len(paths) - 1, 2 + self.physical

        def by_row(function: Callable[..., Tensor], states: Tensor, *others: Tensor) -> Tensor:
            """Return, for each row, a function's derivatives by its state (2) and the unknowns except the starts."""
            rows = torch.cat([states, unknowns[: self.physical].expand(len(states), -1)], dim=1)
            return jacobian(lambda rows: function(rows[:, 2:], rows[:, :2], *others), rows)[1]

        durations = self.nodes[1].expand(steps * self.segments)
        of_steps = by_row(self._step, paths[:-1].reshape(-1, 2), durations)
        of_samples = by_row(self._sampled, paths[self.node, self.segment])
        of_paths = [torch.eye(2, columns, dtype=REAL).expand(self.segments, -1, -1)]
        for of_step in of_steps.reshape(steps, self.segments, 2, columns):
            of_paths.append(_chain(of_step, of_paths[-1]))
        at_samples = torch.stack(of_paths)[self.node, self.segment]
        data = self._by_unknowns(_chain(of_samples[:, None], at_samples)[:, 0], self.segment)
        joins = torch.arange(self.segments - 1).repeat_interleave(2)
        gaps = self._by_unknowns(of_paths[-1][:-1].reshape(-1, columns), joins)
        gaps[:, self.physical + 2 :] -= torch.eye(len(joins), dtype=REAL)
        begin = torch.zeros(2, len(unknowns), dtype=REAL)
        begin[:, self.physical : self.physical + 2] = self.is_given.diag()
        return torch.cat([self.weight[0] * data, self.weight[1] * gaps, self.weight[1] * begin]).numpy()

    def _by_unknowns(self, slopes: Tensor, segment: Tensor) -> Tensor:
        """Return the derivatives of n residuals by all k unknowns, (n, k), with zeros for the starts of other segments.

        slopes: derivatives of each residual by the start of its segment (first two columns), and by the unknowns that
        are not starts of segments (other columns). segment: index of the segment of each residual, (n,).
        """
        full = torch.zeros(len(slopes), self.physical + 2 * self.segments, dtype=REAL)
        full[:, : self.physical] = slopes[:, 2:]
        return full.scatter_(1, self.physical + 2 * segment[:, None] + torch.arange(2), slopes[:, :2])

    @torch.no_grad()
    def project(self, x: np.ndarray) -> np.ndarray:
        """Return the damping coefficients, (terms,), in `units`, of the projection of the learnt force on the terms.

        With these coefficients the terms dissipate, as nearly as possible (least squares), the same mean power as the
        learnt force in each segment. All are NaN if a path is not finite. x: the unknowns, (k,).
        """
        unknowns = torch.from_numpy(x)
        velocity = self.paths(unknowns)[..., 1]
        flat = velocity.flatten()
        if not torch.all(torch.isfinite(flat)):
            return np.full(self.units.size, np.nan)
        speed = self.a * self.w
        power = (flat * self.force(unknowns, flat) * speed * self.w).reshape(velocity.shape).mean(0)
        shapes = self.damping_shapes(speed * flat) * torch.from_numpy(self.units)
        of_law = (flat[:, None] * shapes).reshape(*velocity.shape, -1).mean(0)
        return np.linalg.lstsq(of_law.numpy(), power.numpy(), rcond=None)[0]


def _runge_kutta(rate: Callable[[Tensor], Tensor], start: Tensor, times: Tensor) -> Tensor:
    """Return the states (m, …) at times (m,), with one Runge–Kutta step of order 4 from each time to the next.

    rate: maps a state to its time derivative. start: the state at the first time.
    """
    return cast(Tensor, odeint(lambda _, state: rate(state), start, times, method="rk4"))


def _chain(outer: Tensor, inner: Tensor) -> Tensor:
    """Return the derivatives, (…, m, 2 + k), of a step's end by the start of its path (2) and the k unknowns.

    It is the chain rule. outer (…, m, 2 + k): derivatives of the step's end by the state before the step (2) and the
    unknowns. inner (…, 2, 2 + k): derivatives of this state by the start of the path and the unknowns.
    """
    total = outer[..., :2] @ inner
    total[..., 2:] += outer[..., 2:]
    return total


@single_thread()
def estimate(
    signal: Signal, problem: Problem, features: Features, rng: np.random.Generator, options: Any
) -> Estimate:
    """Train a network for the damping force, and return its projection on the damping terms as the estimate.

    Unknown restoring parameters and an unknown start are those of the trained model. There are no standard errors. The
    details are lists of velocities (`velocity`, rad/s), and at these the learnt force (`force`) and that of the damping
    terms (`law`), both in rad/s². The outcome is a sentence if the training did not converge.

    Parameters
    ----------
    signal, problem, features
        The record, its damping terms and known parameters, and its features.
    rng
        Random generator for the first weights.
    options
        Options of the estimator, `NeuralOdeOptions`.

    Raises
    ------
    Refusal
        If a trajectory is not finite.
    """
    loss = Shooting(signal, problem, features, rng, options)
    training = train(descend(loss.evaluate, loss.first), options.rounds, loss.project, STEADY, loss.y.numel())
    if not np.all(np.isfinite(training.watched)):
        raise Refusal("the training of the network gave trajectories that are not finite")
    x, coefficients = training.x, training.watched * loss.units
    values = dict(zip(loss.coefficients, coefficients.tolist()))
    values |= dict(zip(loss.restoring, (x[loss.count : loss.physical] * loss.free_units.numpy()).tolist()))
    angle, velocity = x[loss.physical : loss.physical + 2].tolist()
    values |= free_start(problem, loss.rest + loss.a * angle, loss.a * loss.w * velocity)
    peak = loss.paths(torch.from_numpy(x))[..., 1].abs().max().item()
    grid = torch.linspace(-peak, peak, GRID, dtype=REAL)
    details = {
        "velocity": (loss.a * loss.w * grid).tolist(),
        "force": (loss.a * loss.w**2 * loss.force(torch.from_numpy(x), grid)).tolist(),
        "law": (loss.damping_shapes(loss.a * loss.w * grid) @ torch.from_numpy(coefficients)).tolist(),
    }
    count, outcome = training.evaluations, training.outcome
    return Estimate("neural_ode", "initial", values, details=details, evaluations=count, outcome=outcome)
