"""The noise of a record's samples: which model it follows, and the values that a least-squares fit is made to.

The candidates of an answer are fitted and weighed under white Gaussian noise. Any other noise model reaches them
through two things: the record's values are replaced by the motion plus the model's working residuals, in which an
outlier counts for little and rounding for nothing, and the variance is that of the white noise which tells as much
about the oscillation. Both depend on the motion, so that they are found in turn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bayesdamp.inference.deviation.candidate import Linearised, linearised, refit, relinearised
from bayesdamp.inference.deviation.data import Data, prepared
from bayesdamp.inference.deviation.least_squares import Fit
from bayesdamp.inference.noise import NOISES
from bayesdamp.inference.noise._residuals import FittedNoise, fit_noise
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.kernel.solve import NONE
from bayesdamp.priors import Prior
from bayesdamp.types import Refusal, Signal

GAUSSIAN = "gaussian"
CORRELATED = "correlated"
AUTOMATIC = (GAUSSIAN, CORRELATED, "student_t", "quantised")
"""Noise models that are weighed where none is asked for."""
LEAD = 5.0
"""Nats by which another noise model must be ahead of Gaussian noise (conventional)."""
ORDER = 8
"""Of the autoregression that shows whether residuals can be predicted from those before them (conventional)."""
MOST_CYCLES = 1200.0
"""Cycles up to which the ODE is solved where amplitudes and phases do not stand for it: their tangents take 1 GB
(measured)."""
WORTH = 0.7
"""Share of its variance that noise must fall to under another model than the Gaussian, for the ODE to be solved where
amplitudes and phases would do: it takes twice as long."""
ROUNDS = 10
"""Changes of the working residuals, at most."""
SETTLED = 0.05
"""Standard deviations of the whole record's noise by which the motion may still change."""


def noises_of(asked: str | Sequence[str]) -> tuple[str, ...]:
    """Return the names of the noise models that are weighed: those asked for, or for "auto" the automatic ones and all
    that plug-ins add."""
    names = (asked,) if isinstance(asked, str) else tuple(asked)
    return (*AUTOMATIC, *NOISES.added()) if names == ("auto",) else names


def prepared_for(
    signal: Signal,
    names: Sequence[str],
    known: Mapping[str, float],
    priors: Mapping[str, Prior],
    average: bool,
) -> Data:
    """Return the data of a signal under these noise models.

    Amplitudes and phases of a record of very many cycles have Gaussian noise. They are not taken where another model is
    the likeliest on what they leave of the record and tells more.

    Parameters
    ----------
    signal : Signal
        The record.
    names : sequence of str
        Noise models to choose from.
    known, priors : mapping
        Values and priors of the noise's parameters in place of the default priors.
    average : bool
        Whether amplitudes and phases may be taken.

    Raises
    ------
    Refusal
        Where the record does not oscillate.
    """
    data = prepared(signal, average=average and GAUSSIAN in names)
    if data.averaged is None or len(names) == 1 or data.cycles > MOST_CYCLES:
        return data
    residual, gaps = data.averaged.residual, np.diff(signal.t[: data.averaged.residual.size])
    record = replace(signal, t=signal.t[: residual.size], y=signal.y[: residual.size])
    weighed = _weighed(names, residual, record, data, known, priors)
    found = SampleNoise(max(weighed, key=lambda one: one.log_evidence), weighed)
    if found.name in (GAUSSIAN, CORRELATED) or found.ahead < max(LEAD, predictable(residual)):
        return data
    variance = found.fitted.variance(residual, record.y - record.y.mean(), gaps)
    worth = variance < WORTH * float(residual @ residual) / residual.size
    return prepared(signal, average=False) if worth else data


@dataclass(frozen=True)
class SampleNoise:
    """The noise of a record's samples.

    Attributes
    ----------
    fitted : FittedNoise
        The model that the answer is under, and its parameters.
    weighed : tuple of FittedNoise
        All models that apply to the record, on the residuals of the sum of all terms.
    """

    fitted: FittedNoise = field(default_factory=FittedNoise)
    weighed: tuple[FittedNoise, ...] = ()

    @property
    def name(self) -> str:
        """The noise model that the answer is under."""
        return self.fitted.name

    @property
    def likeliest(self) -> str:
        """The noise model of highest evidence, which may be the correlated one that the answer allows for otherwise."""
        return max(self.weighed, key=lambda one: one.log_evidence, default=self.fitted).name

    @property
    def ahead(self) -> float:
        """Nats by which the answer's model is ahead of Gaussian noise; nan where that was not weighed."""
        logs = {one.name: one.log_evidence for one in self.weighed}
        return logs.get(self.name, np.nan) - logs.get(GAUSSIAN, np.nan)


@dataclass(frozen=True)
class Adapted:
    """A record whose values are those that least squares are made to under a noise model.

    Attributes
    ----------
    data : Data
        The record.
    noise : SampleNoise
        The noise model.
    variance : float
        Variance of the white noise that stands for it, in the record's unit squared, per value of the data. Where the
        noise is taken as Gaussian but is correlated, the least that its variance near the oscillation is.
    """

    data: Data
    noise: SampleNoise
    variance: float


def adapted(
    names: Sequence[str],
    data: Data,
    solver: Solver,
    at: Linearised,
    known: Mapping[str, float],
    priors: Mapping[str, Prior],
    approximate: bool,
) -> Adapted | None:
    """Choose the noise model of a record, and adapt the record's values to it.

    Parameters
    ----------
    names : sequence of str
        Noise models to choose from.
    data : Data
        The record as it is.
    solver : Solver
        Of the motions.
    at : Linearised
        The candidate with all terms, about its mode under Gaussian noise.
    known, priors : mapping
        Values and priors of parameters, those of noise models among them.
    approximate : bool
        Whether laws may hold approximately.

    Returns
    -------
    Adapted or None
        None where only Gaussian noise can be used.

    Raises
    ------
    Refusal
        Where none of the noise models applies to the record.
    """
    if tuple(names) == (GAUSSIAN,):
        return None
    record, variance = data.record, 0.0
    if record is None:
        if GAUSSIAN in names:
            return None
        raise Refusal(
            f"{data.cycles:.0f} cycles are compared as amplitudes and phases, whose noise is Gaussian; "
            f"{names[0]} noise cannot be used"
        )
    motion = _at_samples(solver, data, at)
    if motion is None:
        return None
    weighed = _weighed(names, record.y - motion, record, data, known, priors)
    by_name = {one.name: one for one in weighed}
    noise, plain = max(weighed, key=lambda one: one.log_evidence), by_name.get(GAUSSIAN)
    found, gaps = at.fit, np.diff(record.t)
    ahead = np.inf if plain is None else noise.log_evidence - plain.log_evidence
    gain = predictable(record.y - motion)
    if plain is not None and (ahead < LEAD or noise.name == CORRELATED or gain > ahead):
        # What can be predicted may not be noise, but a second mode, or what a law leaves that does not hold. It is left
        # to the power of the residual near the oscillation (`inflation`), which is at least that of correlated noise
        # where this explains as much as any autoregression.
        other = by_name.get(CORRELATED, plain)
        if other.log_evidence - plain.log_evidence > max(LEAD, gain - LEAD):
            variance = other.variance(record.y - motion, motion - motion.mean(), gaps) / data.thinned
        return Adapted(data, SampleNoise(plain, weighed), variance)
    for _ in range(ROUNDS):
        residual = record.y - motion
        variance = noise.variance(residual, motion - motion.mean(), gaps)
        working = noise.working_residuals(residual, gaps, variance)
        data = data.working(working - residual)
        there = _mode(at, solver, data, found, approximate)
        if there is None:
            break
        moved = float(np.linalg.norm(there.motion.y - at.motion.y)) * np.sqrt(data.thinned / variance)
        at, found = there, there.fit
        motion = _at_samples(solver, data, at)
        if motion is None or moved < SETTLED:
            break
        noise = fit_noise(noise.name, record.y - motion, record, data.features, known, priors)
    return Adapted(data, SampleNoise(noise, weighed), data.least_variance + variance / data.thinned)


def _mode(at: Linearised, solver: Solver, data: Data, found: Fit, approximate: bool) -> Linearised | None:
    """The candidate about its mode on changed values; None where no motion follows them."""
    new = refit(solver, data, found)
    if new is None:
        return None
    if not approximate:
        return linearised(at.candidate, solver, data, new)
    about = relinearised(at.candidate, solver, data, new, None)
    return None if about is None else about[0]


def _at_samples(solver: Solver, data: Data, at: Linearised) -> np.ndarray | None:
    """The motion at every sample of the record, (m,); None where it escapes."""
    assert data.record is not None
    d, n = at.fit.z.size, solver.knots.size
    z, g, h = np.split(at.u, [d, d + n])
    every = solver.at(np.array(data.record.t, float), solver.quantity)
    motion = every.solve(at.parameters.values(z), at.fit.active, np.expm1(g), h, NONE)
    return None if motion is None else motion.y


def predictable(residual: np.ndarray) -> float:
    """Compute how many nats an autoregression of residuals (m,) is ahead of white Gaussian noise, never less than 0, by
    least squares and Schwarz's criterion (G. Schwarz, Ann. Stat. 6, 461 (1978))."""
    rows = np.lib.stride_tricks.sliding_window_view(residual, ORDER + 1)
    before, after = rows[:, :-1], rows[:, -1]
    square = before.T @ before
    left = float(after @ after) - float((before.T @ after) @ np.linalg.solve(square, before.T @ after))
    gain = 0.5 * len(rows) * np.log(float(after @ after) / max(left, 1e-300))
    return max(float(gain) - 0.5 * ORDER * np.log(len(rows)), 0.0)


def _weighed(
    names: Sequence[str],
    residual: np.ndarray,
    record: Signal,
    data: Data,
    known: Mapping[str, float],
    priors: Mapping[str, Prior],
) -> tuple[FittedNoise, ...]:
    """Return each noise model that applies to a record, on residuals (m,). Raises Refusal where none does."""
    every: list[FittedNoise] = []
    refused: list[str] = []
    for name in names:
        try:
            every.append(fit_noise(name, residual, record, data.features, known, priors))
        except Refusal as refusal:
            refused.append(str(refusal))
    if not every:
        raise Refusal("; ".join(refused))
    return tuple(every)
