"""Matching the Hilbert envelope of a record to those of trajectories (paper, section 3.3, equation 15)."""

from __future__ import annotations

import numpy as np
from pydantic import Field
from scipy.optimize import least_squares
from scipy.signal import hilbert, savgol_filter

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.search import SCORE, brent
from bayesdamp.estimators.shared import (
    checked_features,
    decay_start,
    free_names,
    further_priors,
    noise_level,
    oscillator,
    start_parameters,
)
from bayesdamp.physics.trajectories import Trajectories
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

LEAST_CYCLES = 3.0
TOLERANCE = 1e-7
"""Largest error of a trajectory, as a share of the amplitude."""


class EnvelopeOptions(Options):
    """window: length of the Savitzky–Golay window in periods.

    above: the part of the record counts whose envelope is more than so many times the noise.
    """

    window: float = Field(default=1.0, gt=0.1, le=4.0)
    above: float = Field(default=6.0, ge=1.0)


class Envelope(Estimator[EnvelopeOptions]):
    """Σ (ln A_observed − ln A_simulated)² least over the damping coefficients.

    Restoring parameters that are not known are set from the record's frequency and midline, and the start
    from the smoothed record; its amplitude is then matched along with the damping. On an uneven clock record
    and trajectories are both read at the record's times and interpolated to an even one.
    """

    options = EnvelopeOptions

    def refuses(self, damping: tuple[str, ...]) -> str | None:
        """A friction whose slope over the position leaves nothing in an envelope."""
        if "dry_position" in damping:
            return (
                "the slope of dry_position's friction takes no energy, so that an envelope says nothing of it"
            )
        return None

    def initial(
        self, signal: Signal, problem: Problem, options: EnvelopeOptions, rng: np.random.Generator
    ) -> Estimate:
        """Coefficients of the trajectory whose Hilbert envelope is closest to the record's."""
        seen = checked_features(signal)
        if seen.cycles < LEAST_CYCLES:
            raise Refusal(f"{seen.cycles:.1f} cycles: an envelope needs at least {LEAST_CYCLES:.0f}")
        match = _Match(signal, problem, options, seen)
        osc, free = match.osc, free_names(problem)
        guess = decay_start(problem, seen)
        units = np.array([1e-5 / term.ratio_per_unit(seen.amplitude, seen.frequency) for term in osc.terms])
        x = np.maximum([guess[name] for name in osc.coefficients], units)
        scaled = "theta0" in free or "omega0" in free
        further = list(match.priors)
        x = np.r_[x, [match.base[n] for n in further]]

        trace: list[float] = []
        scale = 1.0
        if x.size == 1 and not scaled:
            found = brent(lambda c: float(np.mean(match.difference(np.array([c])) ** 2)), x[0], units[0])
            x = found.x
            trace.extend(found.costs)
        else:
            x, scale = _several(match, x, scaled, len(further))
            trace.append(float(np.mean(match.difference(x, scale) ** 2)))
        if not np.all(np.isfinite(match.difference(x, scale))):
            raise Refusal("the trajectory escapes from every start that was tried")
        start = match.parameters(x, scale)
        values = {name: float(start[name]) for name in (*osc.coefficients, *further, *free)}
        return Estimate(
            self.name,
            "initial",
            values,
            trace={"log_mismatch": np.sqrt(trace)},
            evaluations=match.evaluations,
        )


def _several(match: _Match, x: np.ndarray, scaled: bool, further: int) -> tuple[np.ndarray, float]:
    """(coefficients and further parameters, scale of the start) by bounded least squares; further: how many of x are
    parameters beside the coefficients, which vary as normal scores of their priors."""
    k, priors = x.size - further, list(match.priors.values())
    unit = np.maximum(x[:k], x[:k].max() * 1e-3 if k == 1 else 1e-12)
    scores = [float(p.score(v)) for p, v in zip(priors, x[k:], strict=True)]
    low = np.r_[np.zeros(k), [0.0 if p.reflected else -SCORE for p in priors], np.zeros(int(scaled))]
    high = np.r_[np.full(k, np.inf), np.full(further, SCORE), np.full(int(scaled), np.inf)]
    start = np.r_[np.ones(k), np.clip(scores, -SCORE / 2, SCORE / 2), np.ones(int(scaled))]

    def physical(u: np.ndarray) -> np.ndarray:
        own = [float(p.value(np.asarray(z))) for p, z in zip(priors, u[k : x.size], strict=True)]
        return np.r_[u[:k] * unit, own]

    result = least_squares(
        lambda u: np.clip(
            np.nan_to_num(match.difference(physical(u), u[-1] if scaled else 1.0), nan=10.0), -10, 10
        ),
        np.maximum(start, low),
        bounds=(low, high),
        x_scale="jac",
        diff_step=1e-5,
        xtol=1e-11,
        ftol=1e-13,
        gtol=1e-13,
        max_nfev=60,
    )
    return physical(result.x), float(result.x[-1]) if scaled else 1.0


class _Match:
    """The record's log envelope, and that of trajectories treated in the same way."""

    def __init__(self, signal: Signal, problem: Problem, options: EnvelopeOptions, seen: Features) -> None:
        self.osc = oscillator(problem)
        self.quantity = signal.quantity
        self.base = start_parameters(signal, problem, seen)
        self.priors = further_priors(problem, seen)
        self.names = (*self.osc.coefficients, *self.priors)
        self.seen = seen
        self.evaluations = 0
        self.times = signal.t if signal.uniform else np.linspace(signal.t[0], signal.t[-1], signal.t.size)
        self.sampled = signal.t
        y = self.resampled(signal.y)
        gap = self.times[1] - self.times[0]
        self.width = max(5, 2 * int(options.window * seen.period / (2 * gap)) + 1)
        observed = self.envelope(y)
        inside = (self.times > self.times[0] + seen.period / 2) & (
            self.times < self.times[-1] - seen.period / 2
        )
        for start, stop in zip(signal.t, signal.t[1:]) if not signal.uniform else ():
            if stop - start > max(3 * gap, 0.1 * seen.period):  # the envelope there is nothing but a guess
                inside &= (self.times < start - seen.period / 2) | (self.times > stop + seen.period / 2)
        loud = observed > options.above * noise_level(signal)
        quiet = np.flatnonzero(inside & ~loud)
        self.rows = np.flatnonzero(inside & (self.times < (self.times[quiet[0]] if quiet.size else np.inf)))
        if self.rows.size * gap < seen.period:
            raise Refusal("the envelope stands out of the noise for less than a period")
        self.target = np.log(observed[self.rows])
        size = TOLERANCE * float(np.abs(seen.turning_amplitudes).max())
        self.trajectories = Trajectories(self.osc, self.sampled, self.quantity, self.base, size)

    def resampled(self, y: np.ndarray) -> np.ndarray:
        """The record's samples (n,), or a trajectory at its times, on the uniform clock."""
        return y if self.times is self.sampled else np.interp(self.times, self.sampled, y)

    def envelope(self, y: np.ndarray) -> np.ndarray:
        """Smoothed envelope of y (n,) about the record's midline, (n,)."""
        raw = np.abs(np.asarray(hilbert(y - self.seen.rest)))
        width = min(self.width, 2 * ((y.size - 1) // 2) - 1)
        return np.maximum(np.asarray(savgol_filter(raw, width, 3)), 1e-300)

    def parameters(self, x: np.ndarray, scale: float = 1.0) -> dict[str, float]:
        """All parameters; the start is scaled about the midline."""
        p = {**self.base, **dict(zip(self.names, map(float, x)))}
        rest = self.seen.rest if self.quantity == "angle" else 0.0
        return p | {"theta0": rest + scale * (p["theta0"] - rest), "omega0": scale * p["omega0"]}

    def difference(self, x: np.ndarray, scale: float = 1.0) -> np.ndarray:
        """ln A_simulated − ln A_observed over the rows; 10 where the trajectory escapes."""
        self.evaluations += 1
        y = self.trajectories.record(self.parameters(x, scale))
        if not np.all(np.isfinite(y)):
            return np.full(self.rows.size, 10.0)
        return np.log(self.envelope(self.resampled(y))[self.rows]) - self.target


PLUGIN = Envelope()
