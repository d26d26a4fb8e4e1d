"""Tests of the residuals at a mode: peaks of their spectrum, and score tests for forces that the model lacks.

The spectrum shows structure near the frequency of the oscillation, at its overtones, and at low frequencies.

A score test detects a misfit of a few nats along one direction in the space of residuals, which the spectrum does not
show. The direction is the change of the fitted motion by a small additional force. It is computed by variation of
parameters, from the derivatives of the motion by its start (Coddington and Levinson, Theory of Ordinary Differential
Equations, 1955, section 3.6). The fitted directions (changes of the motion by fitted parameters) are projected out of
both. If the model is right, the projection of the residuals on the direction is then standard normal (Rao, Proceedings
of the Cambridge Philosophical Society 44, 1948).
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

OVERTONES = (2, 3)
"""Overtones at which the spectrum of the residuals is tested, as multiples of the frequency of the oscillation."""
BAND_NEIGHBOURS = 2
"""In the test of the residuals' spectrum, number of neighbouring frequencies on either side that are tested together
with a frequency, in steps of 1/duration. The residual of an oscillation under a wrong damping law is modulated slowly,
which spreads its peak over them."""
SLOW_TURNS = (0.5, 1.0, 1.5)
"""Low frequencies at which the spectrum of the residuals is tested, in cycles per duration of the record."""
LEAST_REMAINING_NORM = 0.3
"""The spectrum of the residuals is tested by projections on test waves (sines and cosines). A combination of them is
left out if at most this fraction of its norm remains after the changes of the residuals by fitted parameters are
projected out."""
MOST_SAMPLES = 20_000
"""Greatest number of values in the search for the largest peak of the residuals' spectrum; a longer record is averaged
in blocks. The frequencies that are lost are far above the tested overtones."""

# Clauses on the largest peak in the spectrum of the residuals; they follow "structure remains in the residuals: ".
AT_OSCILLATION = "at the frequency of the oscillation, as if damping or stiffness had another form or changed"
AT_OVERTONES = (
    "at overtones of the oscillation, as if the restoring force or the recorder's scale were nonlinear"
)
SLOW_STRUCTURE = "at low frequencies, as if the record's zero drifted"
OTHER_OSCILLATION = "another oscillation, {ratio:.2g} times as fast, as of a second mode or a drive"

PARTS_PER_STEP = 32
"""Number of parts into which each step of the ODE solver is divided for the integral of the response to a force."""
NEAR_REST = 0.1
"""Width of the velocity range in which the tested form "friction is larger at low velocity" acts, as a fraction of the
largest velocity."""
REVERSAL_WIDTH = 0.02
"""Width of the velocity range within which the tested form "friction is larger at low velocity" changes its sign, as a
fraction of the largest velocity."""
LEAST_REMAINING_LENGTH = 1e-3
"""An additional force is not tested if fitted parameters can replace it: if, of the change that it causes in the
whitened residuals, at most this fraction (of its norm) remains after the changes by fitted parameters are projected
out."""


@dataclass(frozen=True)
class SpectralLine:
    """The most significant peak of the residuals' spectrum.

    Attributes
    ----------
    chance : float
        p value of the peak under white noise. `find_spectral_line` corrects it for the number of its tests.
    words : str
        Description of the peak, to follow "structure remains in the residuals: ".
    """

    chance: float
    words: str


def find_spectral_line(
    t: np.ndarray, scores: np.ndarray, period: float, absorbed: np.ndarray
) -> SpectralLine:
    """Find the most significant peak in the spectrum of whitened residuals.

    It tests bands of frequencies at the oscillation, at its overtones and, unless the record has few cycles, at low
    frequencies; and the largest peak of the periodogram. In a band, the squared projection of the residuals on waves,
    from which the fitted directions are projected out, is chi-square distributed. The largest of m ordinates of the
    periodogram exceeds x with probability 1−(1−e^−x)^m (Fisher 1929).

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times in s.
    scores : ndarray, shape (n,)
        The whitened residuals.
    period : float
        Period of the oscillation in s.
    absorbed : ndarray, shape (n, k)
        Orthonormal basis of the fitted directions, which are the derivatives of the residuals by the fitted parameters.

    Returns
    -------
    SpectralLine
        The peak with the smallest p value, corrected for the number of tests.
    """
    length, cycles, across = _extent(t, period)
    fastest = 0.5 * t.size / length
    around = np.arange(-across, across + 1) / length
    bands = [
        (AT_OSCILLATION, 1 / period + around),
        (AT_OVERTONES, np.concatenate([k / period + around for k in OVERTONES])),
    ]
    if cycles > 2 * (across + 1):
        bands.append((SLOW_STRUCTURE, np.array(SLOW_TURNS) / length))
    lines = []
    for words, frequencies in bands:
        phase = 2 * np.pi * np.outer(t - t[0], frequencies[frequencies < fastest])
        waves = orthonormal(np.hstack([np.cos(phase), np.sin(phase)]))
        u, s, _ = np.linalg.svd(waves - absorbed @ (absorbed.T @ waves), full_matrices=False)
        remaining = u[:, s > LEAST_REMAINING_NORM]
        power = 0.5 * np.sum((remaining.T @ scores) ** 2)
        chance = float(scipy.special.gammaincc(0.5 * remaining.shape[1], power)) if remaining.size else 1.0
        lines.append(SpectralLine(chance, words))
    lines.append(find_largest_peak(t, scores, period))
    best = min(lines, key=lambda line: line.chance)
    return SpectralLine(min(1.0, len(lines) * best.chance), best.words)


def _extent(t: np.ndarray, period: float) -> tuple[float, float, int]:
    """Return the duration of a record in s, its number of cycles, and the half-width of a band of frequencies.

    The half-width is a number of steps of 1/duration: a third of the number of cycles, rounded down, but at most
    `BAND_NEIGHBOURS`. The duration includes one sampling interval after the last sample. period: period of the
    oscillation in s.
    """
    length = float(t[-1] - t[0]) * t.size / (t.size - 1)
    return length, length / period, int(np.clip(length / period / 3, 0, BAND_NEIGHBOURS))


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis, (n, r), of the space that columns, (n, k), span.

    The columns are first scaled to unit length. Negligible columns and directions are left out, so that r may be below
    k.
    """
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300)]
    if columns.shape[1] == 0:
        return columns
    u, s, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    return u[:, s > 1e-6 * s[0]]


def find_largest_peak(t: np.ndarray, scores: np.ndarray, period: float) -> SpectralLine:
    """Return the largest peak of the periodogram; its p value is corrected for the number of frequencies.

    t: times in s, (n,), taken as evenly spaced; gaps broaden a peak, which then is only less significant. scores:
    whitened residuals, (n,); of other residuals only the words of the result have a meaning. period: period of the
    oscillation in s.
    """
    _, cycles, across = _extent(t, period)
    block = -(-scores.size // MOST_SAMPLES)
    many = scores.size // block
    blocks = scores[: many * block].reshape(many, block).sum(axis=1) / np.sqrt(block)
    power = np.abs(np.fft.rfft(blocks - blocks.mean()))[1:] ** 2 / many
    top = int(np.argmax(power))
    chance = -np.expm1(power.size * np.log1p(-np.exp(-power[top]))) if power[top] < 700 else 0.0
    turns, words = top + 1, OTHER_OSCILLATION.format(ratio=(top + 1) / cycles)
    if turns < 0.5 * cycles:
        words = SLOW_STRUCTURE
    elif abs(turns - cycles) < across + 1:
        words = AT_OSCILLATION
    elif any(abs(turns - k * cycles) < across + 1 for k in OVERTONES):
        words = AT_OVERTONES
    return SpectralLine(float(chance), words)


@dataclass(frozen=True)
class Form:
    """A form of force that a model may lack.

    Attributes
    ----------
    words : str
        Description for the report.
    force : callable
        Function of displacement from the equilibrium and velocity, each divided by its largest value, and of time,
        which goes from −½ to ½ over the record, (n,) each; it returns the force, (n,), in an arbitrary unit.
    """

    words: str
    force: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


FORMS = (
    Form("damping grows faster than with the square of the velocity", lambda x, v, t: v**3),
    Form("damping grows more slowly than with the velocity", lambda x, v, t: np.sign(v) * np.sqrt(np.abs(v))),
    Form(
        "friction is larger at low velocity",
        lambda x, v, t: np.tanh(v / REVERSAL_WIDTH) * np.exp(-((v / NEAR_REST) ** 2)),
    ),
    Form("damping depends on the displacement", lambda x, v, t: x**2 * v),
    Form("damping changes with time", lambda x, v, t: t * v),
    Form("stiffness changes with time", lambda x, v, t: t * x),
    Form("the restoring force has an additional cubic part", lambda x, v, t: x**3),
)
"""Forms of force that `find_missing_form` tests, with x, v and t scaled as `Form.force` says. Their descriptions follow
"the residuals look as if "."""


@dataclass(frozen=True)
class StrongestForm:
    """The form of additional force that would reduce the residuals most.

    Attributes
    ----------
    chance : float
        p value of the reduction, corrected for the number of forms; 1 if nothing was tested.
    words : str
        Description of the form; "" if nothing was tested.
    """

    chance: float = 1.0
    words: str = ""


def find_missing_form(
    mode: Mode,
    scores: np.ndarray,
    absorbed: np.ndarray,
    whiten: Callable[[np.ndarray], np.ndarray],
) -> StrongestForm:
    """Find the form of additional force that would reduce the whitened residuals most.

    Nothing is tested if the motion is unbounded, or under exact friction (ε = 0), where it is not a smooth function of
    its start.

    Parameters
    ----------
    mode : Mode
        Mode of the model.
    scores : ndarray, shape (n,)
        The whitened residuals.
    absorbed : ndarray, shape (n, k)
        Orthonormal basis of the fitted directions, which are the derivatives of the whitened residuals by the fitted
        parameters.
    whiten : callable
        Function that returns the change of the whitened residuals, (n,), for a change of the residuals, (n,).

    Returns
    -------
    StrongestForm
        The form with the smallest p value.
    """
    likelihood = mode.likelihood
    osc = likelihood.target.oscillator
    p = likelihood.target.all_values(mode.z)
    motion = likelihood.motions.motion(p)
    if motion is None or (osc.switches and p["epsilon"] == 0.0):
        return StrongestForm()
    chances: list[tuple[float, str]] = []
    for form, response in zip(FORMS, responses_to_forms(likelihood, motion, p), strict=True):
        direction = whiten(response)
        size = np.linalg.norm(direction)
        direction = direction - absorbed @ (absorbed.T @ direction)
        remaining = np.linalg.norm(direction)
        if np.isfinite(remaining) and remaining > LEAST_REMAINING_LENGTH * size > 0:
            score = float(direction @ scores / remaining)
            chances.append((float(scipy.special.erfc(abs(score) / np.sqrt(2))), form.words))
    chance, words = min(chances, default=(1.0, ""))
    return StrongestForm(min(1.0, len(chances) * chance), words)


def responses_to_forms(likelihood: Likelihood, motion: Motion, p: Mapping[str, float]) -> np.ndarray:
    """Compute the response of the recorded quantity to each additional force in `FORMS`.

    The equation of motion gets the acceleration −`Form.force` on the right-hand side, in units of rad/s² (m/s²). The
    response is that of the linearised motion, as to a small force, in the unit of the record. It is not finite after
    friction has ended the motion.

    Parameters
    ----------
    likelihood : Likelihood
        Likelihood of the record of n samples.
    motion : Motion
        The fitted motion, with its derivatives by the start.
    p : mapping of str to float
        All parameters of the motion.

    Returns
    -------
    ndarray, shape (forms, n)
        The change of the recorded quantity at each sample, one row for each form.
    """
    from bayesdamp.physics.kernel.dense import at_times, slopes_at_times

    signal, osc = likelihood.target.signal, likelihood.target.oscillator
    assert isinstance(motion.slopes, Slopes)
    nodes, slopes = motion.times, motion.slopes.slopes
    names = likelihood.motions.kernel_names
    starts = motion.slopes.columns[[names.index("theta0"), names.index("omega0")]]
    grid = (nodes[:-1, None] + np.diff(nodes)[:, None] * np.arange(PARTS_PER_STEP) / PARTS_PER_STEP).ravel()
    grid = np.append(grid, nodes[-1])
    times = signal.t - signal.t[0]
    x, v = (at_times(nodes, motion.states, grid, order) for order in (0, 1))
    try:
        rest = osc.equilibrium(p, p["theta0"])
    except ValueError:  # the law has no equilibrium
        rest = float(np.mean(motion.states[:, 0]))
    # Derivatives of position and velocity by the angle and by the velocity at the start.
    by_angle, by_velocity = np.stack(
        [slopes_at_times(nodes, slopes, starts, grid, 1, order) for order in (0, 1)], axis=1
    ).T
    wronskian = by_angle[0] * by_velocity[1] - by_angle[1] * by_velocity[0]
    wronskian[wronskian == 0.0] = np.nan  # friction has ended the motion
    unit_x, unit_v = np.abs(x - rest).max(), np.abs(v).max()
    order = QUANTITIES.index(signal.quantity)
    first, second = slopes_at_times(nodes, slopes, starts, times, 1, order).T
    effects = []
    for form in FORMS:
        force = -form.force((x - rest) / unit_x, v / unit_v, grid / grid[-1] - 0.5)
        integrand = np.stack([by_angle[0], by_velocity[0]]) * force / wronskian
        steps = np.cumsum(0.5 * (integrand[:, 1:] + integrand[:, :-1]) * np.diff(grid), axis=1)
        summed = np.concatenate([np.zeros((2, 1)), steps], axis=1)
        along_angle, along_velocity = (np.interp(times, grid, s) for s in summed)
        # Variation of parameters: y = u₂ ∫u₁f/W − u₁ ∫u₂f/W.
        response = second * along_angle - first * along_velocity
        effects.append(response + np.interp(times, grid, force) if order == 2 else response)
    return np.array(effects)
