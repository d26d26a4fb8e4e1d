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

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import erfc, log_ndtr

from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.physics.kernel import Motion
from bayesdamp.physics.kernel.solve import Slopes
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.types import AddedForm

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
class Other:
    """The force that would take most off the residuals: the chance of as much by noise, for all that were tried.

    rivals: of each form of damping that the model lacks.
    """

    chance: float = 1.0
    words: str = ""
    rivals: tuple[AddedForm, ...] = ()


def other_form(
    mode: Mode,
    scores: np.ndarray,
    absorbed: np.ndarray,
    whiten: Callable[[np.ndarray], np.ndarray],
) -> Other:
    """Return of all forms the one that the whitened residuals, scores (n,), want most.

    absorbed: an orthonormal basis, (n, k), of what was fitted; whiten: what a change of the residuals, (n,), does to
    the scores. Under exact friction (ε = 0) the motion is not smooth in its start: nothing is tested.
    """
    likelihood = mode.likelihood
    p = likelihood.target.all_values(mode.z)
    motion = likelihood.motions.motion(p)
    if motion is None or (likelihood.target.oscillator.switches and p["epsilon"] == 0.0):
        return Other()
    found: list[tuple[float, str]] = []
    rivals: list[AddedForm] = []
    osc = likelihood.target.oscillator
    law = [float(p[name]) for name in osc.law.parameters]
    forces = [-a - osc.law.kernel(x, law) for x, _, a in motion.states[:, :3].tolist()]
    largest = float(np.max(np.abs(forces)))
    for form, moved in zip(FORMS, responses(likelihood, motion, p), strict=True):
        direction = whiten(moved)
        size = np.linalg.norm(direction)
        direction = direction - absorbed @ (absorbed.T @ direction)
        left = np.linalg.norm(direction)
        score, log_bayes = 0.0, 0.0  # a direction that says nothing leaves the odds as they were
        if np.isfinite(left) and left > NEW * size > 0:
            score = float(direction @ scores / left)
            found.append((float(erfc(abs(score) / np.sqrt(2))), form.words))
            length = SIZE * largest * left / size * np.sqrt(likelihood.information(moved, mode.z))
            log_bayes = log_bayes_factor(score, float(length), form.signed)
        if form.damps:
            rivals.append(AddedForm(form.words, log_bayes))
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


def responses(likelihood: Likelihood, motion: Motion, p: Mapping[str, float]) -> np.ndarray:
    """Return what a small force of each form does to the recorded quantity along a motion: shape (forms, n)."""
    from bayesdamp.physics.kernel.dense import at_times, slopes_at_times

    signal, osc = likelihood.target.signal, likelihood.target.oscillator
    assert isinstance(motion.slopes, Slopes)
    nodes, slopes = motion.times, motion.slopes.slopes
    names = likelihood.motions.kernel_names
    starts = motion.slopes.columns[[names.index("theta0"), names.index("omega0")]]
    grid = np.append(
        (nodes[:-1, None] + np.diff(nodes)[:, None] * np.arange(PARTS) / PARTS).ravel(), nodes[-1]
    )
    sought = signal.t - signal.t[0]
    x, v = (at_times(nodes, motion.states, grid, order) for order in (0, 1))
    rest = _rest(osc, p, motion.states[:, 0])
    # Position and velocity of the motion's derivatives by its angle and its velocity at the start.
    one, other = np.stack([slopes_at_times(nodes, slopes, starts, grid, order) for order in (0, 1)], axis=1).T
    wronskian = one[0] * other[1] - one[1] * other[0]
    unit_x, unit_v = np.abs(x - rest).max(), np.abs(v).max()
    place = ("angle", "velocity", "acceleration").index(signal.quantity)
    first, second = slopes_at_times(nodes, slopes, starts, sought, place).T
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


def _rest(osc: Oscillator, p: Mapping[str, float], angles: np.ndarray) -> float:
    """Where the motion through these angles, (m,), comes to rest; its mean where the law has no such place."""
    try:
        return osc.equilibrium(p, p["theta0"])
    except ValueError:
        return float(np.mean(angles))
