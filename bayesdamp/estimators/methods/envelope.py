"""Estimate damping by fitting the Hilbert envelope of a simulated motion to that of the record.

The method is that of section 3.3, equation 15, of the paper that `bayesdamp.estimators` cites.
"""

import numpy as np
from pydantic import Field
from scipy.optimize import least_squares
from scipy.signal import hilbert, savgol_filter

from bayesdamp.estimators.shared import (
    Estimator,
    Options,
    checked_features,
    decay_start,
    free_names,
    noise_level,
    oscillator,
    ratios_per_unit,
    rest_position,
    start_parameters,
)
from bayesdamp.physics.oscillator import Trajectories
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

LEAST_CYCLES = 3.0
"""Least number of cycles of a record (conventional). A record with fewer is refused."""
TOLERANCE = 1e-7
"""Largest numerical error of a simulated trajectory, as a fraction of the amplitude."""


class EnvelopeOptions(Options):
    """Options of the envelope method.

    window: length, in periods, of the Savitzky–Golay filter that smooths the envelopes. above: smallest ratio of the
    record's envelope to its noise; the record is used until the ratio first falls below this. Half a period at the ends
    and at interruptions of the sampling is not used, because the envelope is wrong there.
    """

    window: float = Field(default=1.0, gt=0.1, le=4.0)
    above: float = Field(default=6.0, ge=1.0)


class Envelope(Estimator[EnvelopeOptions]):
    """Find the damping coefficients that minimise Σ (ln A_observed − ln A_simulated)², with the Hilbert envelopes A.

    Unknown restoring parameters are computed from the record's frequency and midline. An unknown start of the motion is
    computed from the smoothed record, and its amplitude is then fitted together with the damping. The coefficients are
    not negative. Record and simulated motions with uneven times are interpolated linearly to uniform times.
    """

    options = EnvelopeOptions

    def initial(
        self, signal: Signal, problem: Problem, options: EnvelopeOptions, rng: np.random.Generator
    ) -> Estimate:
        """Fit the damping coefficients to the record's Hilbert envelope, and return the unknown parameters.

        If theta0 or omega0 (the start of the motion) is unknown, a common factor on both is fitted too, even if one of
        them is known. Unknown restoring parameters are not fitted: they are computed from the record's frequency and
        midline. There are no standard errors. Raises Refusal if `checked_features` or `motion` does, if the record has
        fewer than `LEAST_CYCLES` cycles, if its envelope is above `options.above` times the noise (6 by default) for
        less than a period, or if the trajectory is unbounded.
        """
        features = checked_features(signal)
        if features.cycles < LEAST_CYCLES:
            raise Refusal(
                f"the record has {features.cycles:.1f} cycles; the envelope method needs at least {LEAST_CYCLES:.0f}"
            )
        match = _EnvelopeMatch(signal, problem, options, features)
        free, guess = free_names(problem), decay_start(problem, features)
        units = 1e-5 / ratios_per_unit(problem, features)
        coefficients = np.maximum([guess[name] for name in match.osc.coefficients], units)

        # An unknown start is only a rough guess from the record, so its amplitude is fitted too.
        x, scale = match.fit(coefficients, scaled="theta0" in free or "omega0" in free)
        parameters = match.parameters(x, scale)
        if not np.all(np.isfinite(match.trajectories.record(parameters))):
            raise Refusal("no simulated motion has finite values; check the known values and the laws")
        values = {name: float(parameters[name]) for name in (*match.osc.coefficients, *free)}
        return Estimate(self.name, "initial", values, evaluations=match.evaluations)


class _EnvelopeMatch:
    """Compare the logarithm of the record's envelope with that of simulated motions, computed in the same way.

    used: indices of the uniform times at which they are compared, (u,). observed_log: logarithm of the record's
    envelope there, (u,). base: parameters of the motion except the damping coefficients, by name. evaluations: number
    of simulated motions so far.
    """

    def __init__(
        self, signal: Signal, problem: Problem, options: EnvelopeOptions, features: Features
    ) -> None:
        self.osc = oscillator(problem)
        self.base = start_parameters(signal, problem, features)
        self.midline, self.rest = features.rest, rest_position(signal, problem, features)
        self.evaluations = 0
        self.record_times, period = signal.t, features.period
        self.times = signal.t if signal.uniform else np.linspace(signal.t[0], signal.t[-1], signal.t.size)
        gap = self.times[1] - self.times[0]
        self.filter_width = max(5, 2 * int(options.window * period / (2 * gap)) + 1)
        observed = self._envelope(signal.y)
        # The envelope is wrong within half a period of the ends and of gaps.
        inside = (self.times > self.times[0] + period / 2) & (self.times < self.times[-1] - period / 2)
        if not signal.uniform:
            for start, stop in zip(signal.t, signal.t[1:]):
                if stop - start > max(3 * gap, 0.1 * period):  # a gap
                    inside &= (self.times < start - period / 2) | (self.times > stop + period / 2)
        # The record is used until its envelope first comes near the noise.
        quiet = np.flatnonzero(inside & ~(observed > options.above * noise_level(signal)))
        self.used = np.flatnonzero(inside & (self.times < (self.times[quiet[0]] if quiet.size else np.inf)))
        if self.used.size * gap < period:
            much = f"{options.above:g} times the noise"
            raise Refusal(f"the envelope is above {much} for less than a period; reduce the option `above`")
        self.observed_log = np.log(observed[self.used])
        tolerance = TOLERANCE * float(np.abs(features.turning_amplitudes).max())
        self.trajectories = Trajectories(self.osc, self.record_times, signal.quantity, self.base, tolerance)

    def _envelope(self, y: np.ndarray) -> np.ndarray:
        """Return the smoothed Hilbert envelope of y (n,) about the record's midline, at the uniform times, (n,)."""
        y = y if self.times is self.record_times else np.interp(self.times, self.record_times, y)
        raw = np.abs(np.asarray(hilbert(y - self.midline)))
        width = min(self.filter_width, 2 * ((y.size - 1) // 2) - 1)
        return np.maximum(np.asarray(savgol_filter(raw, width, 3)), 1e-300)

    def parameters(self, x: np.ndarray, scale: float = 1.0) -> dict[str, float]:
        """Return all parameters of the trajectory, by name, for values x (k,) of the damping coefficients.

        The initial velocity, and the initial displacement from the record's midline (from the equilibrium for a
        recorded velocity or acceleration), are multiplied by `scale`.
        """
        p = {**self.base, **dict(zip(self.osc.coefficients, map(float, x)))}
        return p | {"theta0": self.rest + scale * (p["theta0"] - self.rest), "omega0": scale * p["omega0"]}

    def log_difference(self, x: np.ndarray, scale: float = 1.0) -> np.ndarray:
        """Return ln A_simulated − ln A_observed at the used samples, (u,).

        Every value is 10 if the trajectory is unbounded. x: the damping coefficients, (k,). scale: factor
        of the initial velocity and of the initial displacement from the midline or equilibrium (see `parameters`).
        """
        self.evaluations += 1
        y = self.trajectories.record(self.parameters(x, scale))
        if not np.all(np.isfinite(y)):
            return np.full(self.used.size, 10.0)
        return np.log(self._envelope(y)[self.used]) - self.observed_log

    def fit(self, coefficients: np.ndarray, scaled: bool) -> tuple[np.ndarray, float]:
        """Fit the damping coefficients by bounded least squares, starting from the given values.

        No coefficient becomes negative. If `scaled`, a factor ≥ 0 on the initial state of the motion is fitted too (see
        `parameters`); it starts at 1. Return the k coefficients, (k,), in the units of `coefficients`, and this factor
        (1.0 if not `scaled`).
        """
        k = coefficients.size
        units = np.maximum(coefficients, coefficients.max() * 1e-3 if k == 1 else 1e-12)

        def residuals(u: np.ndarray) -> np.ndarray:
            difference = self.log_difference(u[:k] * units, u[-1] if scaled else 1.0)
            return np.clip(np.nan_to_num(difference, nan=10.0), -10, 10)

        result = least_squares(
            residuals,
            np.ones(k + scaled),
            bounds=(0.0, np.inf),
            x_scale="jac",
            diff_step=1e-5,
            xtol=1e-11,
            ftol=1e-13,
            gtol=1e-13,
            max_nfev=60,
        )
        return result.x[:k] * units, float(result.x[-1]) if scaled else 1.0


PLUGIN = Envelope()
