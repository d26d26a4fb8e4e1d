"""Choose the noise model of a record's samples, and adapt the record so that least squares are correct under it.

Fits and evidence assume white Gaussian noise. Another noise model changes two things:

- Each residual (record minus motion) is replaced by a working residual: minus the derivative of the log noise density
  by the residual, times a variance. Outliers and rounding then have little effect.
- The variance of the noise is that of white noise with the same information about the oscillation.

Both depend on the motion, so motion and working residuals are updated in turn.
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
"""Names of the noise models that are compared by default. Correlated noise never replaces Gaussian noise (see
`_most_probable_noise`)."""
LEAD_NATS = 5.0
"""Another noise model is chosen instead of Gaussian noise only if its log evidence is at least this many nats larger
(conventional), and at least `predictable_nats` larger."""
AUTOREGRESSION_ORDER = 8
"""Number of preceding residuals from which `predictable_nats` predicts each residual (conventional)."""
OSCILLATION_BAND = (0.3, 2.0)
"""Lower and upper limit of the frequency band that counts as near the oscillation, in units of the oscillation's
frequency (conventional). Residuals in this band affect the inferred damping."""
STRETCHES, MOST_SAMPLES = 64, 50_000
"""Limits of the number of samples from which the noise model is chosen, for a record that is reduced to amplitudes and
phases (conventional). Of more than `MOST_SAMPLES` samples about this many are used, in `STRETCHES` runs of consecutive
samples that are spread evenly over the record. They determine the parameters of the noise to one per cent."""


def noises_of(asked: str | Sequence[str]) -> tuple[str, ...]:
    """Return the names of the noise models to choose from.

    asked: one or several names, which are returned unchecked; or "auto" alone for the models `AUTOMATIC` and all noise
    models that plug-ins have added.
    """
    names = (asked,) if isinstance(asked, str) else tuple(asked)
    return (*AUTOMATIC, *NOISES.added()) if names == ("auto",) else names


def prepare_for_noises(
    signal: Signal,
    names: Sequence[str],
    known: Mapping[str, float],
    priors: Mapping[str, Prior],
    average: bool,
) -> Data:
    """Prepare a signal for fits, and choose the noise model if the signal is reduced to amplitudes and phases.

    A record of very many cycles is reduced to amplitudes and phases. The noise model is then chosen for the residual of
    the samples from a fit of these, unless `names` contains only Gaussian noise; it is in `Data.noise_model`. Unless it
    is Gaussian or correlated noise, amplitudes and phases are estimated again under it. For other records,
    `adapt_to_noise` chooses the noise model later, for the residual of a motion.

    Parameters
    ----------
    signal : Signal
        The record.
    names : sequence of str
        Names of the noise models to choose from.
    known, priors : mapping
        Values and priors of the noise's parameters, by name, in place of the default priors; other names have no
        effect.
    average : bool
        Whether the record may be reduced to amplitudes and phases.

    Raises
    ------
    InputError
        If a noise model is chosen here and a name is unknown.
    Refusal
        Where the record does not oscillate or has fewer than ten samples, or a noise model is chosen here and none
        applies.
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
    noise = _most_probable_noise(names, data.averaged.residual[used], fit_one)[0]
    if noise.name in LEAST_SQUARES:
        return replace(data, noise_model=noise)
    data = prepare_data(signal, average, noise)
    if data.averaged is None:
        return data
    # Fit the parameters of the noise model again, to the residual under it.
    fitted = fit_one(noise.name, data.averaged.residual[used])
    return prepare_data(signal, average, replace(noise, fitted=fitted))


def _most_probable_noise(
    names: Sequence[str], residual: np.ndarray, fit_one: Callable[[str, np.ndarray], FittedNoise]
) -> tuple[SampleNoise, float]:
    """Choose the noise model of residuals, (m,), by its evidence.

    The model with the largest evidence is chosen, with one exception. Gaussian noise, if it is among the models, is
    chosen instead if that model is correlated noise, or if its lead in log evidence over Gaussian noise is less than
    `LEAD_NATS` or `predictable_nats(residual)`: predictable residuals may be a second mode of oscillation or the misfit
    of a law.

    Parameters
    ----------
    names : sequence of str
        Names of the noise models.
    residual : ndarray, shape (m,)
        Record minus motion at each sample.
    fit_one : callable
        Function that fits the noise model with a name (first argument) to residuals (second argument). It raises
        Refusal if the model does not apply, which is then left out.

    Returns
    -------
    SampleNoise
        The chosen model, and all fitted models.
    float
        `predictable_nats(residual)`.

    Raises
    ------
    Refusal
        If no model applies.
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
    lead = max(LEAD_NATS, gain)
    if plain is not None and (best.name == CORRELATED or best.log_evidence - plain.log_evidence < lead):
        best = plain
    return SampleNoise(best, tuple(models)), gain


@dataclass(frozen=True)
class AdaptedData:
    """A record that is adapted to a noise model, so that a fit by least squares is correct under this noise.

    Attributes
    ----------
    data : Data
        The record, in which the values are replaced by motion plus working residuals; unchanged under Gaussian noise.
        With these values, least squares give the most probable motion under the noise model.
    noise : SampleNoise
        The noise model.
    variance : float
        Variance of the equivalent white noise, the same for every value of `data`, in the record's unit squared. Under
        Gaussian noise it is only a lower bound for the variance: 0, or for correlated residuals the variance of the
        noise near the oscillation.
    """

    data: Data
    noise: SampleNoise
    variance: float


def adapt_to_noise(
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
        The candidate with all damping terms, linearised about its most probable motion (mode) under Gaussian noise.
    known, priors : mapping
        Values and priors of the noise's parameters, by name, in place of the default priors; other names have no
        effect.
    approximate : bool
        Whether deviations from the laws are allowed when the motion is fitted again to the adapted values.

    Returns
    -------
    AdaptedData or None
        None if Gaussian noise is the only choice, if the record is reduced to amplitudes and phases (whose noise model
        is chosen by `prepare_for_noises`), or if the motion is unbounded.

    Raises
    ------
    InputError
        If the name of a noise model is unknown.
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
    chosen, gain = _most_probable_noise(names, record.y - motion, fit_one)
    gaps, noise = np.diff(record.t), chosen.fitted
    if noise.name == GAUSSIAN:
        # `inflation` allows for correlated residuals. Where correlated noise explains them as well as an autoregression
        # does, its variance near the oscillation is a lower bound.
        other = next((model for model in chosen.weighed if model.name == CORRELATED), noise)
        if other.log_evidence - noise.log_evidence > max(LEAD_NATS, gain - LEAD_NATS):
            variance = other.variance(record.y - motion, motion - motion.mean(), gaps) / data.thinned
        return AdaptedData(data, chosen, variance)
    for _ in range(ROUNDS):
        # Far from the most probable motion the observed information may be much smaller than the expected one. A step
        # with it would go too far, so that steps use the larger of the two.
        residual = record.y - motion
        variance = noise.variance(residual, motion - motion.mean(), gaps, least=1.0)
        working = data.working(noise.working_residuals(residual, gaps, variance) - residual)
        # Linearise the candidate about its mode for the adapted values.
        fit = refit(solver, working, at.fit)
        if fit is None:
            break
        new = (
            linearise_at_mode(solver, working, fit, None) if approximate else linearise(solver, working, fit)
        )
        moved = None if new is None else _at_samples(solver, record, new)
        if new is None or moved is None:
            break
        change = float(np.linalg.norm(new.motion.y - at.motion.y)) * np.sqrt(data.thinned / variance)
        at, motion = new, moved
        if change < SETTLED:
            break
        noise = fit_one(noise.name, record.y - motion)
    residual = record.y - motion
    variance = noise.variance(residual, motion - motion.mean(), gaps)
    return AdaptedData(
        data.working(noise.working_residuals(residual, gaps, variance) - residual),
        SampleNoise(noise, chosen.weighed),
        data.least_variance + variance / data.thinned,
    )


def _at_samples(solver: Solver, record: Signal, at: Linearisation) -> np.ndarray | None:
    """Return a candidate's motion at the m samples of the record, (m,), in the record's unit; None if it is unbounded.

    at: the linearised candidate; the motion is that at the point of the linearisation. It is not averaged over windows.
    """
    every = solver.at(np.array(record.t, float), solver.quantity)
    motion = every.solve(at.values, at.fit.active, *at.deviations, NONE)
    return None if motion is None else motion.y


def predictable_nats(residual: np.ndarray) -> float:
    """Return by how many nats an autoregression explains residuals, (m,), better than white noise does; at least 0.

    Another noise model must lead Gaussian noise by at least this to replace it. The residuals are in order of time and
    count as equidistant. The order of the autoregression is `AUTOREGRESSION_ORDER`. The result is the difference of the
    log evidences, approximated by least squares and Schwarz's criterion (G. Schwarz, Ann. Stat. 6, 461 (1978)).
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

    κ is the factor by which the variance of white noise is multiplied because residuals are correlated. The power is
    averaged over the frequencies in `OSCILLATION_BAND`. κ is 1 if fewer than three Fourier frequencies are in this
    band, or if the variance is 0.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times in s; the residual is interpolated to equidistant times.
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
