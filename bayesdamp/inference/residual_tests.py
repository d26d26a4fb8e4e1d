"""Tests of the residuals at a mode: in their spectrum, and along the effects of forces that no candidate has.

The spectrum shows structure at the oscillation, at its overtones, and near zero.

A score test sees a misfit of a few nats along one direction, which the spectrum does not show. The direction is the
effect of a small force on the fitted motion: the response of the linearised motion, by variation of parameters from its
derivatives by the start (Coddington and Levinson, Theory of Ordinary Differential Equations, 1955, section 3.6). Where
the model is right, the projection of the residuals on it is a standard normal score (Rao, Proceedings of the Cambridge
Philosophical Society 44, 1948), after the fitted directions are removed from both. The length of the direction,
measured by the noise, is the effect of such a force on the record. With a prior for its size the two give the Bayes
factor of the model with this force added. Where that is about one, the record does not decide.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.physics.kernel import Motion
from bayesdamp.physics.kernel.solve import QUANTITIES, Slopes
from bayesdamp.types import AddedForm

OVERTONES = (2, 3)
ACROSS = 2
"""Frequencies on either side that count with a frequency, in steps of one over the record's length: the residual of an
oscillation under a wrong law has an envelope of a few humps."""
SLOW_TURNS = (0.5, 1.0, 1.5)
"""Slow waves: their turns in the record's length."""
ABSORBED = 0.3
"""A wave is ignored if the fit leaves no more than this share of it."""
MOST = 20_000
"""Largest number of samples in the search for a line; longer records are averaged in blocks. A line above them is far
from any overtone that matters."""

AT_OSCILLATION = "at the frequency of the oscillation, as if damping or stiffness had another form or changed"
AT_OVERTONES = (
    "at overtones of the oscillation, as if the restoring force or the recorder's scale were nonlinear"
)
SLOW = "it is slow, as if the record's zero drifted"
LINE = "another oscillation, {ratio:.2g} times as fast, as of a second mode or a drive"

PARTS = 32
"""Points in a step of the solver at which a force is integrated."""
NEAR_REST = 0.1
"""Share of the largest velocity below which friction counts as friction near rest."""
REVERSAL = 0.02
"""Share of the largest velocity within which that friction reverses."""
NEW = 1e-3
"""A direction is ignored if the fitted directions leave no more than this share of its length."""
SIZE = 0.5
"""Scale of the prior of another force's size (half-normal, or normal where either sign makes sense), as a share of the
largest damping force."""


@dataclass(frozen=True)
class SpectralLine:
    """The strongest part of the residuals' spectrum.

    Attributes
    ----------
    chance : float
        Of such a part under white noise, for all parts together.
    words : str
        Where it is, in words that follow "structure remains in the residuals: ".
    """

    chance: float
    words: str


def standing_out(t: np.ndarray, scores: np.ndarray, period: float, absorbed: np.ndarray) -> SpectralLine:
    """Find the part of the spectrum of whitened residuals that exceeds white noise most.

    The square of the residuals' projection on waves, from which the fitted directions are removed, is chi-square
    distributed. The largest ordinate of a periodogram exceeds x with a chance of 1 − (1 − e^−x)^m (Fisher 1929). A band
    has a fixed number of waves whatever the record's length: for a small chance its power must be some three times that
    of the noise model, which would make intervals too narrow by the root of that.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times in s.
    scores : ndarray, shape (n,)
        The whitened residuals.
    period : float
        Of the oscillation in s.
    absorbed : ndarray, shape (n, k)
        Orthonormal basis of the fitted directions.
    """
    length, cycles, across = _extent(t, period)
    fastest = 0.5 * t.size / length
    around = np.arange(-across, across + 1) / length
    bands = [
        (AT_OSCILLATION, 1 / period + around),
        (AT_OVERTONES, np.concatenate([k / period + around for k in OVERTONES])),
    ]
    if cycles > 2 * (across + 1):
        bands.append((SLOW, np.array(SLOW_TURNS) / length))
    lines = []
    for words, frequencies in bands:
        phase = 2 * np.pi * np.outer(t - t[0], frequencies[frequencies < fastest])
        waves = orthonormal(np.hstack([np.cos(phase), np.sin(phase)]))
        u, s, _ = np.linalg.svd(waves - absorbed @ (absorbed.T @ waves), full_matrices=False)
        left = u[:, s > ABSORBED]
        power = 0.5 * np.sum((left.T @ scores) ** 2)
        lines.append(
            SpectralLine(
                float(scipy.special.gammaincc(0.5 * left.shape[1], power)) if left.size else 1.0, words
            )
        )
    lines.append(_highest(scores, cycles, across))
    best = min(lines, key=lambda line: line.chance)
    return SpectralLine(min(1.0, len(lines) * best.chance), best.words)


def strongest(t: np.ndarray, residual: np.ndarray, period: float) -> str:
    """Return where residuals (n,), not whitened, have most power, in the words of a `SpectralLine`."""
    _, cycles, across = _extent(t, period)
    return _highest(residual, cycles, across).words


def _extent(t: np.ndarray, period: float) -> tuple[float, float, int]:
    """Return a record's length in s, its cycles, and how many frequencies on either side count with one."""
    length = float(t[-1] - t[0]) * t.size / (t.size - 1)
    return length, length / period, int(np.clip(length / period / 3, 0, ACROSS))


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis, (n, r), of the span of columns (n, k), each scaled to the same length."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300)]
    if columns.shape[1] == 0:
        return columns
    u, s, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    return u[:, s > 1e-6 * s[0]]


def _highest(scores: np.ndarray, cycles: float, across: int) -> SpectralLine:
    """Return the highest of all ordinates; gaps that smear a line over several only make it harder to see."""
    block = -(-scores.size // MOST)
    many = scores.size // block
    blocks = scores[: many * block].reshape(many, block).sum(axis=1) / np.sqrt(block)
    power = np.abs(np.fft.rfft(blocks - blocks.mean()))[1:] ** 2 / many
    top = int(np.argmax(power))
    chance = -np.expm1(power.size * np.log1p(-np.exp(-power[top]))) if power[top] < 700 else 0.0
    turns, words = top + 1, LINE.format(ratio=(top + 1) / cycles)
    if turns < 0.5 * cycles:
        words = SLOW
    elif abs(turns - cycles) < across + 1:
        words = AT_OSCILLATION
    elif any(abs(turns - k * cycles) < across + 1 for k in OVERTONES):
        words = AT_OVERTONES
    return SpectralLine(float(chance), words)


@dataclass(frozen=True)
class Form:
    """A force that no candidate has.

    Attributes
    ----------
    words : str
        For the report.
    force : callable
        Of displacement and velocity in units of their largest values, and of time in units of the record's length from
        −½ to ½, all of shape (n,).
    damps : bool
        Whether it is a damping force.
    signed : bool
        Whether it may have either sign.
    """

    words: str
    force: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    damps: bool = True
    signed: bool = False


FORMS = (
    Form("damping grows faster than with the square of the velocity", lambda x, v, t: v**3),
    Form("damping grows more slowly than with the velocity", lambda x, v, t: np.sign(v) * np.sqrt(np.abs(v))),
    Form(
        "friction is larger near rest",
        lambda x, v, t: np.tanh(v / REVERSAL) * np.exp(-((v / NEAR_REST) ** 2)),
    ),
    Form("damping depends on the displacement", lambda x, v, t: x**2 * v, signed=True),
    Form("damping changes with time", lambda x, v, t: t * v, signed=True),
    Form("stiffness changes with time", lambda x, v, t: t * x, damps=False),
    Form("the restoring force bends", lambda x, v, t: x**3, damps=False),
)


@dataclass(frozen=True)
class StrongestForm:
    """The force that would reduce the residuals most.

    Attributes
    ----------
    chance : float
        Of such a reduction by noise, for all forces that were tried.
    words : str
        Of its form.
    rivals : tuple of AddedForm
        One for each form of damping that the model lacks.
    """

    chance: float = 1.0
    words: str = ""
    rivals: tuple[AddedForm, ...] = ()


def other_form(
    mode: Mode,
    scores: np.ndarray,
    absorbed: np.ndarray,
    whiten: Callable[[np.ndarray], np.ndarray],
) -> StrongestForm:
    """Find the form of force that the whitened residuals show most.

    Under exact friction (ε = 0) the motion is not smooth in its start, and nothing is tested.

    Parameters
    ----------
    mode : Mode
        Of the model.
    scores : ndarray, shape (n,)
        The whitened residuals.
    absorbed : ndarray, shape (n, k)
        Orthonormal basis of the fitted directions.
    whiten : callable
        Maps a change of the residuals, (n,), to that of the scores.
    """
    likelihood = mode.likelihood
    osc = likelihood.target.oscillator
    p = likelihood.target.all_values(mode.z)
    motion = likelihood.motions.motion(p)
    if motion is None or (osc.switches and p["epsilon"] == 0.0):
        return StrongestForm()
    chances: list[tuple[float, str]] = []
    rivals: list[AddedForm] = []
    law = [float(p[name]) for name in osc.law.parameters]
    forces = [-a - osc.law.kernel(x, law) for x, _, a in motion.states[:, :3].tolist()]
    largest = float(np.max(np.abs(forces)))
    for form, moved in zip(FORMS, responses(likelihood, motion, p), strict=True):
        direction = whiten(moved)
        size = np.linalg.norm(direction)
        direction = direction - absorbed @ (absorbed.T @ direction)
        left = np.linalg.norm(direction)
        score, log_bayes = 0.0, 0.0  # an ignored direction leaves the odds as they were
        if np.isfinite(left) and left > NEW * size > 0:
            score = float(direction @ scores / left)
            chances.append((float(scipy.special.erfc(abs(score) / np.sqrt(2))), form.words))
            length = SIZE * largest * left / size * np.sqrt(likelihood.information(moved, mode.z))
            log_bayes = log_bayes_factor(score, float(length), form.signed)
        if form.damps:
            rivals.append(AddedForm(form.words, log_bayes))
    chance, words = min(chances, default=(1.0, ""))
    return StrongestForm(min(1.0, len(chances) * chance), words, tuple(rivals))


def log_bayes_factor(score: float, length: float, signed: bool) -> float:
    """Return the log Bayes factor, in nats, of a force whose direction has this score and length.

    The length is that at one sd of the prior of the force's size. A size of s sds reduces the residuals by
    score·length·s − (length·s)²/2 nats. The exponential of this is averaged over a normal s, or over a half-normal one
    where the size cannot be negative. The fitted parameters follow the force, also below zero.
    """
    shrunk = length * length / (1.0 + length * length)
    log = 0.5 * (shrunk * score * score - np.log1p(length * length))
    return float(log if signed else log + np.log(2.0) + scipy.special.log_ndtr(score * np.sqrt(shrunk)))


def responses(likelihood: Likelihood, motion: Motion, p: Mapping[str, float]) -> np.ndarray:
    """Return the effect of a small force of each form on the recorded quantity along a motion, (forms, n).

    Parameters
    ----------
    likelihood : Likelihood
        Whose motion it is.
    motion : Motion
        With its slopes.
    p : mapping of str to float
        Every parameter of the motion.
    """
    from bayesdamp.physics.kernel.dense import at_times, slopes_at_times

    signal, osc = likelihood.target.signal, likelihood.target.oscillator
    assert isinstance(motion.slopes, Slopes)
    nodes, slopes = motion.times, motion.slopes.slopes
    names = likelihood.motions.kernel_names
    starts = motion.slopes.columns[[names.index("theta0"), names.index("omega0")]]
    grid = (nodes[:-1, None] + np.diff(nodes)[:, None] * np.arange(PARTS) / PARTS).ravel()
    grid = np.append(grid, nodes[-1])
    sought = signal.t - signal.t[0]
    x, v = (at_times(nodes, motion.states, grid, order) for order in (0, 1))
    try:
        rest = osc.equilibrium(p, p["theta0"])
    except ValueError:  # the law has no equilibrium there
        rest = float(np.mean(motion.states[:, 0]))
    # Position and velocity of the motion's derivatives by its angle and by its velocity at the start.
    by_angle, by_velocity = np.stack(
        [slopes_at_times(nodes, slopes, starts, grid, order) for order in (0, 1)], axis=1
    ).T
    wronskian = by_angle[0] * by_velocity[1] - by_angle[1] * by_velocity[0]
    unit_x, unit_v = np.abs(x - rest).max(), np.abs(v).max()
    place = QUANTITIES.index(signal.quantity)
    first, second = slopes_at_times(nodes, slopes, starts, sought, place).T
    effects = []
    for form in FORMS:
        force = -form.force((x - rest) / unit_x, v / unit_v, grid / grid[-1] - 0.5)
        with np.errstate(
            divide="ignore", invalid="ignore"
        ):  # no direction where friction has ended the motion
            through = np.stack([by_angle[0], by_velocity[0]]) * force / wronskian
        steps = np.cumsum(0.5 * (through[:, 1:] + through[:, :-1]) * np.diff(grid), axis=1)
        summed = np.concatenate([np.zeros((2, 1)), steps], axis=1)
        along_angle, along_velocity = (np.interp(sought, grid, s) for s in summed)
        moved = second * along_angle - first * along_velocity
        effects.append(moved + np.interp(sought, grid, force) if place == 2 else moved)
    return np.array(effects)
