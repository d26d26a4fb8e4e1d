"""Score tests: would a force that no candidate has take something off the residuals?

Along one direction a test sees a misfit of a few nats, of which a look at the spectrum shows nothing. The direction is
what a small force does to the fitted trajectory: the linearised motion's response, by variation of parameters from its
derivatives by the start (Coddington and Levinson, Theory of Ordinary Differential Equations, 1955, section 3.6).
Where the model is right, the residuals' projection on it is a standard normal score (Rao, Proceedings of the Cambridge
Philosophical Society 44, 1948), after what was fitted is taken out of both. The length of the direction, as the noise
measures it, says what such a force would do to the record: with a prior for its size the two give the Bayes factor of
the model with this force beside it. Where that is about one, the record does not tell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import erfc, log_ndtr

from bayesdamp.inference.fit.mode import Mode, mesh_of
from bayesdamp.inference.model.residuals import information
from bayesdamp.inference.model.target import Target
from bayesdamp.physics.oscillator import Oscillator, damping_shapes
from bayesdamp.physics.solver.steps import MeshPlan, many_nodes

STEP = 1e-4
"""Share of the motion by which its start is moved for the derivatives."""
PARTS = 32
"""Points in a step of the solver at which a force is summed up."""
SLOW = 0.1
"""Share of the largest velocity below which friction counts as that near rest."""
TURNS = 0.02
"""And that within which it turns over."""
NEW = 1e-3
"""A direction of which what was fitted leaves no more than this share, in length, says nothing."""
SIZE = 0.5
"""Scale of the prior of another form's size (half-normal, normal where either sign makes sense), as a share of the
largest damping force."""


@dataclass(frozen=True)
class Form:
    """A force that no candidate has; of displacement and velocity in units of their largest and of time in units of the
    record's length, −½ to ½, all of shape (n,). damps: whether it is one of damping; signed: whether it may have either
    sign."""

    words: str
    force: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    damps: bool = True
    signed: bool = False


FORMS = (
    Form("damping grows faster than with the square of the velocity", lambda x, v, t: v**3),
    Form("damping grows more slowly than with the velocity", lambda x, v, t: np.sign(v) * np.sqrt(np.abs(v))),
    Form("friction is larger near rest", lambda x, v, t: np.tanh(v / TURNS) * np.exp(-((v / SLOW) ** 2))),
    Form("damping depends on the displacement", lambda x, v, t: x**2 * v, signed=True),
    Form("damping changes with time", lambda x, v, t: t * v, signed=True),
    Form("stiffness changes with time", lambda x, v, t: t * x, damps=False),
    Form("the restoring force bends", lambda x, v, t: x**3, damps=False),
)


@dataclass(frozen=True)
class Rival:
    """The model with another form of damping beside its own: log Bayes factor, in nats, against the model alone."""

    words: str
    log_bayes: float


@dataclass(frozen=True)
class Other:
    """The force that would take most off the residuals: the chance of as much by noise, for all that were tried.

    rivals: of each form of damping that the model lacks.
    """

    chance: float = 1.0
    words: str = ""
    rivals: tuple[Rival, ...] = ()


def other_form(
    target: Target,
    mode: Mode,
    scores: np.ndarray,
    absorbed: np.ndarray,
    whiten: Callable[[np.ndarray], np.ndarray],
) -> Other:
    """Of all forms the one that the whitened residuals, scores (n,), want most.

    absorbed: an orthonormal basis, (n, k), of what was fitted; whiten: what a change of the residuals, (n,), does to
    the scores. Exact friction (ε = 0) has no derivatives by the start: nothing is tested.
    """
    if target.exact_friction:
        return Other()
    plan = mesh_of(target, mode)
    found: list[tuple[float, str]] = []
    rivals: list[Rival] = []
    largest = _largest_damping(target, plan, mode.z)
    for form, moved in zip(FORMS, responses(target, plan, mode.z), strict=True):
        direction = whiten(moved)
        size = np.linalg.norm(direction)
        direction = direction - absorbed @ (absorbed.T @ direction)
        left = np.linalg.norm(direction)
        score, log_bayes = 0.0, 0.0  # a direction that says nothing leaves the odds as they were
        if np.isfinite(left) and left > NEW * size > 0:
            score = float(direction @ scores / left)
            found.append((float(erfc(abs(score) / np.sqrt(2))), form.words))
            length = SIZE * largest * left / size * np.sqrt(information(target, moved, mode.z))
            log_bayes = log_bayes_factor(score, float(length), form.signed)
        if form.damps:
            rivals.append(Rival(form.words, log_bayes))
    chance, words = min(found, default=(1.0, ""))
    return Other(min(1.0, len(found) * chance), words, tuple(rivals))


def log_bayes_factor(score: float, length: float, signed: bool) -> float:
    """Log Bayes factor, in nats, of a force whose direction has this score and, at one sd of its prior, this length.

    Its size s, in sds of its prior, takes score·length·s − (length·s)²/2 nats off the residuals: the exponential of
    which is averaged over a normal s, or a half-normal one where it cannot be negative. What was fitted follows the
    force, also below zero.
    """
    shrunk = length * length / (1.0 + length * length)
    found = 0.5 * (shrunk * score * score - np.log1p(length * length))
    return float(found if signed else found + np.log(2.0) + log_ndtr(score * np.sqrt(shrunk)))


def _largest_damping(target: Target, plan: MeshPlan, z: np.ndarray) -> float:
    """The largest damping force along the trajectory at scores z, (d,), in rad/s²."""
    osc, p = target.oscillator, target.all_values(z)
    motion = many_nodes(osc, plan, {n: np.array([p[n]]) for n in osc.inputs})[0, : int(plan.count) + 1]
    known = {n: p[n] for n in osc.inputs}
    shapes = np.asarray(damping_shapes(osc)(motion[:, 0], motion[:, 1], known))
    return float(np.max(np.abs([p[name] for name in osc.coefficients] @ shapes)))


def responses(target: Target, plan: MeshPlan, z: np.ndarray) -> np.ndarray:
    """What a small force of each form does to the recorded quantity at scores z, (d,): shape (forms, n)."""
    from scipy.interpolate import CubicHermiteSpline

    osc, p = target.oscillator, target.all_values(z)
    t, count = target.signal.t, int(plan.count)
    nodes = np.concatenate([[0.0], np.cumsum(np.asarray(plan.steps)[:count])])
    apart = np.append(True, np.diff(nodes) > 0)
    nodes = nodes[apart]

    def solved(*moves: dict[str, float]) -> np.ndarray:
        values = {n: np.array([p[n] + move.get(n, 0.0) for move in moves]) for n in osc.inputs}
        return many_nodes(osc, plan, values)[:, : count + 1][:, apart]

    (here,) = solved({})
    rest = _rest(osc, p, here[:, 0])
    away = {"theta0": STEP * float(np.ptp(here[:, 0])), "omega0": STEP * float(np.ptp(here[:, 1]))}
    up, down, faster, slower = solved(*({n: sign * h} for n, h in away.items() for sign in (1, -1)))
    grid = np.append(
        (nodes[:-1, None] + np.diff(nodes)[:, None] * np.arange(PARTS) / PARTS).ravel(), nodes[-1]
    )
    sought = t - t[0]

    def along(columns: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Position, velocity and acceleration (nodes, 3) at other times, (3, m)."""
        position = CubicHermiteSpline(nodes, columns[:, 0], columns[:, 1])
        velocity = CubicHermiteSpline(nodes, columns[:, 1], columns[:, 2])
        return np.stack([position(at), velocity(at), np.interp(at, nodes, columns[:, 2])])

    by_angle = (up - down) / (2 * away["theta0"])
    by_velocity = (faster - slower) / (2 * away["omega0"])
    x, v, _ = along(here, grid)
    one, other = along(by_angle, grid), along(by_velocity, grid)
    wronskian = one[0] * other[1] - one[1] * other[0]
    unit_x, unit_v = np.abs(x - rest).max(), np.abs(v).max()
    place = ("angle", "velocity", "acceleration").index(target.signal.quantity)
    first, second = along(by_angle, sought)[place], along(by_velocity, sought)[place]
    found = []
    for form in FORMS:
        force = -form.force((x - rest) / unit_x, v / unit_v, grid / grid[-1] - 0.5)
        with np.errstate(
            divide="ignore", invalid="ignore"
        ):  # friction has ended the motion: no direction is found
            through = np.stack([one[0], other[0]]) * force / wronskian
        summed = np.concatenate(
            [np.zeros((2, 1)), np.cumsum(0.5 * (through[:, 1:] + through[:, :-1]) * np.diff(grid), axis=1)],
            axis=1,
        )
        by_one, by_other = (np.interp(sought, grid, s) for s in summed)
        moved = second * by_one - first * by_other
        found.append(moved + np.interp(sought, grid, force) if place == 2 else moved)
    return np.array(found)


def _rest(osc: Oscillator, p: dict[str, float], angles: np.ndarray) -> float:
    """Where the motion through these angles, (m,), comes to rest; its mean where the law has no such place."""
    try:
        return osc.equilibrium(p, p["theta0"])
    except ValueError:
        return float(np.mean(angles))
