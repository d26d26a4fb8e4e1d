"""Choose the noise model of a record's samples, and adapt the record so that least squares are correct under it.

Fits and evidence assume white Gaussian noise. Another noise model changes two things. First, each residual of the
record is replaced by a working residual: minus the derivative of the log noise density by the residual, times a
variance. In it an outlier has little effect, and rounding none. Second, the variance of the noise is that of white
noise with the same information about the oscillation. Both depend on the motion, so motion and working residuals are
updated in turn.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from bayesdamp.inference.deviation.averaged import ROUNDS, SETTLED
from bayesdamp.inference.deviation.candidate import Linearisation, linearise, linearise_at_mode, refit
from bayesdamp.inference.deviation.data import LEAST_SQUARES, Data, prepare_data
from bayesdamp.inference.noise import CORRELATED, GAUSSIAN, NOISES, FittedNoise, SampleNoise, fit_noise
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.kernel.solve import NONE
from bayesdamp.priors import Prior
from bayesdamp.types import Refusal, Signal

AUTOMATIC = (GAUSSIAN, CORRELATED, "student_t", "quantised")
"""Noise models from which the best one is chosen by default."""
LEAD_NATS = 5.0
"""Another noise model is chosen instead of Gaussian noise only if its log evidence is larger by at least this many nats
(conventional)."""
AUTOREGRESSION_ORDER = 8
"""Number of preceding residuals from which `predictable_nats` predicts each residual (conventional)."""
OSCILLATION_BAND = (0.3, 2.0)
"""Limits of the frequency band that counts as near the oscillation, where residuals affect the damping, in units of the
oscillation's frequency."""
STRETCHES, MOST_SAMPLES = 64, 50_000
"""The noise model of a long record is chosen from part of its samples: from this number of stretches along the record,
with this number of samples in all, which determine its parameters to one per cent (conventional)."""


def noises_of(asked: str | Sequence[str]) -> tuple[str, ...]:
    """Return the names of the noise models to choose from: those given, or for "auto" `AUTOMATIC` and all plug-ins."""
    names = (asked,) if isinstance(asked, str) else tuple(asked)
    return (*AUTOMATIC, *NOISES.added()) if names == ("auto",) else names


def prepare_for_noises(
    signal: Signal,
    names: Sequence[str],
    known: Mapping[str, float],
    priors: Mapping[str, Prior],
    average: bool,
) -> Data:
    """Prepare the data of a signal, and choose the noise model if they are amplitudes and phases.

    A record of very many cycles is reduced to amplitudes and phases. They are the most probable ones under the noise
    model that is chosen for the residual of the samples in their fit; it is in `Data.noise_model`. Otherwise `adapt`
    chooses the noise model later, for the residual of a motion.

    Parameters
    ----------
    signal : Signal
        The record.
    names : sequence of str
        Names of the noise models to choose from.
    known, priors : mapping
        Values and priors, by name, of the noise's parameters, in place of the default priors; other names have no
        effect.
    average : bool
        Whether the record may be reduced to amplitudes and phases.

    Raises
    ------
    Refusal
        Where the record does not oscillate, or none of the noise models applies to it.
    """
    data = prepare_data(signal, average)
    if data.averaged is None or tuple(names) == (GAUSSIAN,):
        return data
    t = np.asarray(signal.t, float)
    used = np.arange(data.averaged.residual.size)
    if used.size > MOST_SAMPLES:  # stretches along the record
        firsts = np.linspace(0, used.size - MOST_SAMPLES // STRETCHES, STRETCHES).astype(int)
        used = (firsts[:, None] + np.arange(MOST_SAMPLES // STRETCHES)).ravel()
    record = replace(signal, t=t[used], y=np.asarray(signal.y)[used])
    fit_one = partial(fit_noise, signal=record, features=data.features, known=known, priors=priors)
    noise = _choose_noise(names, data.averaged.residual[used], fit_one)[0]
    if noise.name in LEAST_SQUARES:
        return replace(data, noise_model=noise)
    data = prepare_data(signal, average, noise)
    if data.averaged is None:
        return data
    # Fit the parameters of the noise model again, to the residual under it.
    fitted = fit_one(noise.name, data.averaged.residual[used])
    return prepare_data(signal, average, replace(noise, fitted=fitted))


def _choose_noise(
    names: Sequence[str], residual: np.ndarray, fit_one: Callable[[str, np.ndarray], FittedNoise]
) -> tuple[SampleNoise, float]:
    """Choose the noise model of residuals, (m,); return it with all fitted models, and `predictable_nats(residual)`.

    It is the model with the largest evidence, but Gaussian noise if its lead over Gaussian noise is less than
    `LEAD_NATS` or `predictable_nats`, because predictable residuals may be a second mode of oscillation or the misfit
    of a law. If Gaussian noise is among the models, correlated noise is never chosen. fit_one: function that fits the
    noise model with this name to residuals. Models that do not apply are left out; raises Refusal if none applies.
    """
    models: list[FittedNoise] = []
    refused: list[str] = []
    for name in names:
        try:
            models.append(fit_one(name, residual))
        except Refusal as refusal:
            refused.append(str(refusal))
    if not models:
        raise Refusal("; ".join(refused))
    gain = predictable_nats(residual)
    best = max(models, key=lambda model: model.log_evidence)
    plain = next((model for model in models if model.name == GAUSSIAN), None)
    if plain is not None and (
        best.name == CORRELATED or best.log_evidence - plain.log_evidence < max(LEAD_NATS, gain)
    ):
        best = plain
    return SampleNoise(best, tuple(models)), gain


@dataclass(frozen=True)
class AdaptedData:
    """A record that is adapted to a noise model, so that a fit by least squares is correct under this noise.

    Attributes
    ----------
    data : Data
        The record, whose values are replaced by the motion plus working residuals, with which least squares give the
        most probable motion under this noise; unchanged under Gaussian noise.
    noise : SampleNoise
        The noise model.
    variance : float
        Variance of the equivalent white noise, the same for every value of `data`, in the record's unit squared. Under
        Gaussian noise it is only a lower bound: 0, or for correlated residuals the variance of the noise near the
        oscillation.
    """

    data: Data
    noise: SampleNoise
    variance: float


def adapt(
    names: Sequence[str],
    data: Data,
    solver: Solver,
    at: Linearisation,
    known: Mapping[str, float],
    priors: Mapping[str, Prior],
    approximate: bool,
) -> AdaptedData | None:
    """Choose the noise model for the residual of a motion, and adapt the record to it.

    Parameters
    ----------
    names : sequence of str
        Names of the noise models to choose from.
    data : Data
        The record.
    solver : Solver
        Solver of the motions.
    at : Linearisation
        The candidate with all terms, linearised about its mode under Gaussian noise.
    known, priors : mapping
        Values and priors of parameters, by name, in place of the default priors; only those of noise models have an
        effect.
    approximate : bool
        Whether deviations from the laws are allowed when the motion is fitted again to the adapted values.

    Returns
    -------
    AdaptedData or None
        None where Gaussian noise is the only choice, where the record is reduced to amplitudes and phases, whose noise
        model is chosen before, or where the motion is unbounded.

    Raises
    ------
    Refusal
        Where none of the noise models applies to the record.
    """
    record, variance = data.record, 0.0
    if tuple(names) == (GAUSSIAN,) or record is None:
        return None
    motion = _at_samples(solver, record, at)
    if motion is None:
        return None
    fit_one = partial(fit_noise, signal=record, features=data.features, known=known, priors=priors)
    chosen, gain = _choose_noise(names, record.y - motion, fit_one)
    gaps, noise = np.diff(record.t), chosen.fitted
    if noise.name == GAUSSIAN:
        # `inflation` allows for correlated residuals. Where correlated noise explains them as well as an autoregression
        # does, its variance near the oscillation is a lower bound.
        other = next((model for model in chosen.weighed if model.name == CORRELATED), noise)
        if other.log_evidence - noise.log_evidence > max(LEAD_NATS, gain - LEAD_NATS):
            variance = other.variance(record.y - motion, motion - motion.mean(), gaps) / data.thinned
        return AdaptedData(data, chosen, variance)
    for _ in range(ROUNDS):
        residual = record.y - motion
        variance = noise.variance(residual, motion - motion.mean(), gaps)
        data = data.working(noise.working_residuals(residual, gaps, variance) - residual)
        # Linearise the candidate about its mode for the adapted values.
        fit, new = refit(solver, data, at.fit), None
        if fit is not None and approximate:
            new = linearise_at_mode(solver, data, fit, None)
        elif fit is not None:
            new = linearise(solver, data, fit)
        if new is None:
            break
        moved = float(np.linalg.norm(new.motion.y - at.motion.y)) * np.sqrt(data.thinned / variance)
        at = new
        motion = _at_samples(solver, record, at)
        if motion is None or moved < SETTLED:
            break
        noise = fit_one(noise.name, record.y - motion)
    return AdaptedData(
        data, SampleNoise(noise, chosen.weighed), data.least_variance + variance / data.thinned
    )


def _at_samples(solver: Solver, record: Signal, at: Linearisation) -> np.ndarray | None:
    """Return the linearised candidate's motion at each of the m samples of the record, (m,); None if it is unbounded.

    It is in the record's unit, and not averaged over windows.
    """
    every = solver.at(np.array(record.t, float), solver.quantity)
    motion = every.solve(at.values, at.fit.active, *at.deviations, NONE)
    return None if motion is None else motion.y


def predictable_nats(residual: np.ndarray) -> float:
    """Return by how many nats an autoregression explains residuals, (m,), better than white noise; at least 0.

    The residuals are in order of time and count as equidistant. The autoregression has the order
    `AUTOREGRESSION_ORDER`. The result is the difference of the log evidences, approximated by least squares and
    Schwarz's criterion (G. Schwarz, Ann. Stat. 6, 461 (1978)).
    """
    rows = np.lib.stride_tricks.sliding_window_view(residual, AUTOREGRESSION_ORDER + 1)
    before, after = rows[:, :-1], rows[:, -1]
    square = before.T @ before
    left = float(after @ after) - float((before.T @ after) @ np.linalg.solve(square, before.T @ after))
    gain = 0.5 * len(rows) * np.log(float(after @ after) / max(left, 1e-300))
    return max(float(gain) - 0.5 * AUTOREGRESSION_ORDER * np.log(len(rows)), 0.0)


def inflation(
    t: np.ndarray, left: np.ndarray, frequency: float, removed: int, variance: float | None = None
) -> float:
    """Return κ ≥ 1, the mean power of a residual near the oscillation divided by that of white noise.

    The power is averaged over the frequencies in `OSCILLATION_BAND`. κ is 1 if fewer than three Fourier frequencies are
    in this band, or if the variance is 0.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times in s; the residual is interpolated to equidistant ones.
    left : ndarray, shape (n,)
        Residual of a fit, in the record's unit.
    frequency : float
        Frequency of the oscillation, in rad/s.
    removed : int
        Number of fitted unknowns; they reduce the residual almost only near the oscillation.
    variance : float, optional
        Variance of the white noise, in the record's unit squared; by default that of the residual, |left|² / (n −
        removed).
    """
    n = left.size
    even = np.interp(np.linspace(t[0], t[-1], n), t, left)
    power = np.abs(np.fft.rfft(even)) ** 2 / n
    omega = 2 * np.pi * np.fft.rfftfreq(n, (t[-1] - t[0]) / (n - 1))
    band = (omega > OSCILLATION_BAND[0] * frequency) & (omega < OSCILLATION_BAND[1] * frequency)
    modes = 2 * int(band.sum())
    if variance is None:
        variance = float(left @ left) / max(n - removed, 1)
    if modes < 6 or variance <= 0:
        return 1.0
    # Subtract the fitted unknowns from the degrees of freedom in the band, but at most half of these.
    remaining = max(modes - removed, 0.5 * modes)
    return max(1.0, 2 * float(power[band].sum()) / remaining / variance)
