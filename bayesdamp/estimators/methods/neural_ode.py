"""Neural ordinary differential equation (paper, section 3.6, equation 20).

ẏ = (θ̇, −F_rest(θ) − f(θ̇)) with the restoring law that is known and a network for the damping force f, an odd
function of the velocity. It is trained through the solver by multiple shooting: the record is cut into segments of
about half a cycle that are integrated as one batch, and the gaps between them are part of the loss. The sensitivities
of a trajectory to the weights and to its start are integrated along with it (forward, not adjoint: the network is
small), so that each training step is a Levenberg–Marquardt step.

The coefficients are the projection of the learnt force on the law: the law that takes the same power out of the
motion, segment by segment, as the learnt force does over the velocities of the record.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from pydantic import Field

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.networks import DenseNetwork, ScaledRecord, descend, train
from bayesdamp.estimators.shared import checked_features, free_start
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

MOST_SEGMENTS = 160
GRID = 41
"""Velocities at which the learnt force is reported."""
STEADY = 1e-3
"""Largest relative change of a converged coefficient."""
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
REACH, SHARE = (0.0, 0.5, 0.5, 1.0), np.array([1.0, 2.0, 2.0, 1.0]) / 6
"""Of the classical Runge–Kutta method: how far along the rate before it a stage lies, and the stages' shares."""


class NeuralOdeOptions(Options):
    """Options of the neural ODE.

    width: units in each of the two hidden layers of the force's network.
    steps: of the solver in a cycle. continuity_weight: weight of the gaps between segments in the loss, relative to
    the misfit of the record; both in amplitudes. rounds: largest number of training steps.
    """

    width: int = Field(default=8, ge=2, le=64)
    steps: int = Field(default=48, ge=12, le=1000)
    continuity_weight: float = Field(default=1.0, gt=0.0)
    rounds: int = Field(default=150, ge=1, le=5000)


class NeuralOde(Estimator[NeuralOdeOptions]):
    """The damping force as a network, and its projection on the law.

    A negative coefficient is reported as it is. details: the learnt force (`force`, rad/s²) on a grid of velocities
    (`velocity`, rad/s), and that of the law with the estimated coefficients (`law`).
    """

    by_position = "its network is a force of the velocity alone"
    with_parameters = "its force is projected on functions with one coefficient each"
    options = NeuralOdeOptions

    def initial(
        self, signal: Signal, problem: Problem, options: NeuralOdeOptions, rng: np.random.Generator
    ) -> Estimate:
        """Train a network for the force in the equation of motion, and project it on the damping terms."""
        loss = Shooting(signal, problem, checked_features(signal), options, rng)
        descent = descend(loss.residuals, loss.linearise, loss.start)
        training = train(descent, options.rounds, loss.project, STEADY)
        if not np.all(np.isfinite(training.watched)):
            raise Refusal("the training came to trajectories that are not finite")
        x, coefficients = training.x, training.watched * loss.units
        values = dict(zip(loss.coefficients, map(float, coefficients[-1])))
        values |= dict(zip(loss.restoring, map(float, x[loss.count : loss.physical] * loss.free_units)))
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
        return Estimate(self.name, "initial", values, {}, trace, details, evaluations=count, outcome=outcome)


class Path(NamedTuple):
    """Segments that were integrated.

    nodes: angle, velocity, acceleration, (segments, steps + 1, 3). stages: angle and velocity at the four stages of
    each step, and at the end in one more step, (2, steps + 1, 4, segments).
    """

    nodes: np.ndarray
    stages: np.ndarray


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
        options: NeuralOdeOptions,
        rng: np.random.Generator,
    ) -> None:
        super().__init__(signal, problem, features)
        self.units = 0.1 / self.ratios
        free = np.array([self.base[name] for name in self.restoring])
        self.free_units = np.maximum(np.abs(free), self.a)
        self.network = DenseNetwork((1, options.width, options.width, 1), biased=False)
        self.count = self.network.count
        self.physical = self.count + free.size
        decay = np.log(max(features.amplitude / features.final_amplitude, 1.05)) / (self.w * signal.t[-1])
        self.force_unit = 2.0 * decay

        end = float(signal.t[-1]) * self.w
        self.segments = int(np.clip(round(end / np.pi), 2, MOST_SEGMENTS))
        length = end / self.segments
        self.intervals = max(8, int(np.ceil(options.steps * length / (2 * np.pi))))
        self.step = length / self.intervals

        # Each sample's segment, the node before it, and the weights of the nodes on either side.
        s = self.t * self.w
        interval = np.clip((s / self.step).astype(int), 0, self.segments * self.intervals - 1)
        self.segment, self.node = np.divmod(interval, self.intervals)
        ends = [Polynomial(c).deriv(self.order) if self.order else Polynomial(c) for c in QUINTIC]
        scale = self.step ** (np.array([0, 1, 2, 0, 1, 2]) - float(self.order))
        dense = np.stack([end(s / self.step - interval) for end in ends], axis=1) * scale
        self.dense = dense.reshape(-1, 2, 3)

        self.weight = (1.0 / self.t.size**0.5, options.continuity_weight)
        states, y = [], self.recorded / (self.a * self.w**self.order)
        for i in range(self.segments):  # angle and velocity of a sinusoid that is fitted near its start
            tau = s - i * length
            near = np.argsort(np.abs(tau), kind="stable")
            near = near[: max(8, int(np.count_nonzero(np.abs(tau) < 0.75 * np.pi)))]
            columns = np.stack([np.cos(tau[near]), np.sin(tau[near]), np.ones(near.size)], axis=1)
            c, d, middle = np.linalg.lstsq(columns, y[near], rcond=1e-6)[0]
            at_rest = (middle - self.rest / self.a) if self.order == 0 else 0.0
            states.append([(c + at_rest, d), (-d, c), (-c, -d)][self.order])
        self.peak = float(self.a * self.w * np.abs(np.array(states)[:, 1]).max())
        self.start = np.concatenate([self.network.draw(rng), free / self.free_units, np.ravel(states)])

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Return the weighted misfit of the samples, gaps between segments, misfit of a known start, (n,)."""
        return self._join(x, self._solve(x).nodes)

    def linearise(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return `residuals` (n,), and their Jacobian by the unknowns."""
        path = self._solve(x)
        tangents = self._tangents(x, path.stages)
        r = self._join(x, path.nodes)
        jacobian = np.zeros((r.size, x.size))
        n, gaps = self.y.size, 2 * (self.segments - 1)
        local = self.weight[0] * self._sampled(tangents)
        jacobian[:n, : self.physical] = local[:, 2:]
        ends = self.weight[1] * tangents[:-1, -1, :2].reshape(gaps, -1)
        jacobian[n : n + gaps, : self.physical] = ends[:, 2:]
        rows, joins = np.arange(n), np.arange(gaps)
        for j in range(2):
            jacobian[rows, self.physical + 2 * self.segment + j] = local[:, j]
            jacobian[n + joins, self.physical + 2 * (joins // 2) + j] = ends[:, j]
        jacobian[n + joins, self.physical + 2 + joins] = -self.weight[1]
        for i, which in enumerate(self.given):
            jacobian[n + gaps + i, self.physical + which] = self.weight[1]
        return r, jacobian

    def force(self, x: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return the learnt force, rad/s², at velocities in rad/s, (n,)."""
        return self.a * self.w**2 * self._force(x, velocity / (self.a * self.w))

    def project(self, x: np.ndarray) -> np.ndarray:
        """Project the learnt force on the damping terms; coefficients (terms,) in units.

        The law takes the same power as the learnt force in each segment, by least squares.
        """
        velocity = self._solve(x).nodes[..., 1] * self.a * self.w
        flat = velocity.reshape(-1)
        shapes = self.damping_shapes(flat)[0] * self.units
        if not np.all(np.isfinite(flat)):
            return np.full(self.units.size, np.nan)
        power = (flat * self.force(x, flat)).reshape(velocity.shape).mean(axis=1)
        of_law = (flat[:, None] * shapes).reshape(*velocity.shape, -1).mean(axis=1)
        return np.linalg.lstsq(of_law, power, rcond=None)[0]

    def _force(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the learnt force (n,) at velocities v (n,), in units of Aω²."""
        return self.force_unit * self.network.jets(x[: self.count], v[None, :, None])[0]

    def _solve(self, x: np.ndarray) -> Path:
        """Integrate all segments from their starts."""
        unit, values, h = self.a * self.w**2, x[self.count : self.physical] * self.free_units, self.step
        state = x[self.physical :].reshape(self.segments, 2).T
        stages = np.empty((2, self.intervals + 1, 4, self.segments))
        nodes = np.empty((3, self.intervals + 1, self.segments))
        for i in range(self.intervals + 1):
            rates = []
            for stage, reach in enumerate(REACH):
                at = state + reach * h * rates[-1] if rates else state
                stages[:, i, stage] = at
                force = self.restoring_force(self.rest + self.a * at[0], values) / unit
                rates.append(np.stack([at[1], -force - self._force(x, at[1])]))
            nodes[:2, i], nodes[2, i] = state, rates[0][1]
            state = state + h * np.tensordot(SHARE, rates, 1)
        return Path(nodes.transpose(2, 1, 0), stages)

    def _tangents(self, x: np.ndarray, stages: np.ndarray) -> np.ndarray:
        """Return the derivatives of the nodes (segments, nodes, 3, c).

        They are by the segment's start (2), the weights and the free restoring parameters.
        """
        unit, values, h = self.a * self.w**2, x[self.count : self.physical] * self.free_units, self.step
        angle, v = stages
        slope, by = self.restoring_slopes(self.rest + self.a * angle, values)
        flat = v.reshape(1, -1, 1)
        jets = self.network.jets(x[: self.count], np.concatenate([flat, np.ones_like(flat)]))
        steep = self.force_unit * jets[1].reshape(v.shape)
        by_weights = self.network.slopes(x[: self.count], flat, np.full((1, v.size), self.force_unit))
        by_weights = by_weights.reshape(*v.shape, -1)
        inputs = -np.concatenate([by_weights, by * self.free_units / unit], axis=-1).swapaxes(1, 2)
        # A step is linear in the tangents at its start and in the derivatives at its four stages.
        step = np.zeros((*v[:, 0].shape, 2, 6))
        step[..., [0, 1], [0, 1]] = 1.0
        rates, begin = [], step
        for stage, reach in enumerate(REACH):
            at = begin + reach * h * rates[-1] if rates else begin
            rate = np.empty_like(at)
            rate[..., 0, :] = at[..., 1, :]
            rate[..., 1, :] = -(
                slope[:, stage, :, None] / self.w**2 * at[..., 0, :]
                + steep[:, stage, :, None] * at[..., 1, :]
            )
            rate[..., 1, 2 + stage] += 1.0
            rates.append(rate)
        step = begin + h * np.tensordot(SHARE, rates, 1)
        pushed = step[..., 2:] @ inputs
        tangents = np.zeros((self.intervals + 1, self.segments, 3, 2 + self.physical))
        tangents[0, :, [0, 1], [0, 1]] = 1.0
        for i in range(self.intervals):
            tangents[i + 1, :, :2] = step[i, :, :, :2] @ tangents[i, :, :2]
            tangents[i + 1, :, :2, 2:] += pushed[i]
        tangents[:, :, 2] = -(
            slope[:, 0, :, None] / self.w**2 * tangents[:, :, 0] + steep[:, 0, :, None] * tangents[:, :, 1]
        )
        tangents[:, :, 2, 2:] += inputs[:, :, 0]
        return tangents.swapaxes(0, 1)

    def _sampled(self, nodes: np.ndarray) -> np.ndarray:
        """Interpolate the nodes' (angle, velocity, acceleration), or their tangents, at the samples."""
        pair = np.stack([nodes[self.segment, self.node], nodes[self.segment, self.node + 1]], axis=1)
        return np.einsum("nij,nij...->n...", self.dense, pair)

    def _join(self, x: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        states = x[self.physical :].reshape(self.segments, 2)
        data = self._sampled(nodes) - self.y
        gaps = (nodes[:-1, -1, :2] - states[1:]).reshape(-1)
        begin = states[0, self.given] - self.begin
        return np.concatenate([self.weight[0] * data, self.weight[1] * gaps, self.weight[1] * begin])


PLUGIN = NeuralOde()
