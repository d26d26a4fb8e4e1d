"""Fit a model to a record, and predict the motion at other times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayesdamp import types
from bayesdamp.estimators.refine import misfit
from bayesdamp.formatting import Table, data_frame, digits, percentage
from bayesdamp.inference.checks import laplace_draws
from bayesdamp.inference.deviation.draws import Quantity, quantity
from bayesdamp.inference.deviation.findings import default_amplitudes
from bayesdamp.inference.deviation.single import FitState, Single, rebuild_single
from bayesdamp.inference.mode import Mode, StoredMode, restore_mode, value_intervals, value_sds
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import GAUSSIAN
from bayesdamp.interface.answer import amplitudes_in_base_unit
from bayesdamp.interface.model import Density, Model, check_signal, fit_approximate, fit_exact, units_of
from bayesdamp.interface.result import (
    BLUE,
    QUIET,
    GivenAxes,
    Result,
    frame_table,
    get_axes,
    list_axes,
    outcome_notes,
)
from bayesdamp.interface.signal import Signal, numbers_of
from bayesdamp.physics.kernel.solve import QUANTITIES
from bayesdamp.physics.oscillator import Oscillator, Trajectories
from bayesdamp.plugins import nearest
from bayesdamp.priors import Prior
from bayesdamp.records.oscillation.features import features
from bayesdamp.serial import Storable
from bayesdamp.verdict.words import UNDETECTED_DEVIATION

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

Vector = NDArray[np.float64]
NO_RATIO_TABLE = (
    "laws hold exactly in this fit, so it has no table of damping ratios; use sample(fit).derived, or fit a Model "
    'with deviation="law"'
)
"""Reason why a fit has no table of damping ratios."""
_EMPTY = np.empty(0)
BAND_DRAWS = 200
"""Number of posterior draws from which the standard deviation of a predicted motion is computed; at least this many if
the model allows deviations from its laws. The relative error of this standard deviation is then 1/√(2·200) = 5 %."""
PRECISION = 1e-6
"""Numerical precision of a predicted motion, as a fraction of the record's range, its largest minus its smallest value
(conventional)."""
PRINTED_TIMES = 8
"""Largest number of times for which a printed `Prediction` shows the motion."""


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Result):
    """A predicted motion at given times.

    Attributes
    ----------
    t
        Times in s, shape (m,).
    value, sd
        Motion of the best fit, and its standard deviation due to the uncertainty of the parameters and, if the model
        allows them, of the deviations from its laws (without noise), each of shape (m,), in `unit`.
    quantity, unit
        The predicted quantity ("angle", "velocity" or "acceleration"), and its unit: that of the signal (rad, m or the
        sensor's), per s or s², not that of the recorded file.
    """

    t: Vector
    value: Vector
    sd: Vector
    quantity: str
    unit: str

    def summary(self) -> pd.DataFrame:
        """Return a table with a row for each time. Its columns are t (s), value and sd (both in `unit`), and unit."""
        return data_frame({"t": self.t, "value": self.value, "sd": self.sd, "unit": self.unit})

    def _table(self) -> Table:
        rows = np.linspace(0, self.t.size - 1, min(PRINTED_TIMES, self.t.size)).astype(int)
        shown = self.summary().take(rows.tolist())
        return frame_table(shown, f"Predicted {self.quantity}: {len(shown)} of {self.t.size} times")


@dataclass(frozen=True)
class StoredFit:
    """The content of a file that stores a fit.

    noise: the chosen noise model. outcome, notes, priors, known: as in `Fit`. mode: the result if the model assumes
    exact laws, else None. law: the result if the model allows deviations from its laws, else None. Both are None if
    nothing was fitted.
    """

    signal: Signal
    model: Model
    noise: str
    outcome: str
    notes: tuple[str, ...]
    priors: Mapping[str, Prior]
    known: Mapping[str, float]
    mode: StoredMode | None
    law: FitState | None


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Result, Storable):
    """The best fit of a model to a record.

    If the model assumes exact laws (`model.deviation` is "none"), the values are the posterior mode in coordinates z in
    which the prior of each parameter is N(0, 1).

    If the model allows deviations from its laws, the values are posterior medians, and sd are total standard
    deviations. Both are from an approximation that is linear about the best motion, with deviations integrated out.

    Attributes
    ----------
    signal, model
        The record and the model.
    noise
        The noise model that was specified, or chosen for the record; "" if nothing was fitted.
    values, units
        Values of the inferred parameters in natural units, and their units, by name; empty if nothing was fitted.
    sd, intervals
        Standard deviation of each parameter and its 95 % interval (low, high), by name. If the model assumes exact
        laws, they are from the normal approximation of the posterior in z, otherwise from draws of the linear
        approximation.
    known
        Values that were not inferred, by name: known or chosen parameters, constants of the noise model or of a term.
    fitted, residuals
        Trajectory, and record minus trajectory, in `signal.y_unit`, each of shape (n,); empty if nothing was fitted. If
        the model allows deviations, the trajectory includes those of the best motion. Both are then NaN at samples that
        are not used (after the amplitude has fallen below 5 % of its first value).
    log_posterior
        Log prior plus log likelihood of the values in nats, as a density in natural units, not normalised; NaN if the
        model allows deviations, or nothing was fitted.
    outcome
        "ok", or a sentence that says why there is no fit.
    notes
        Sentences on the choice of the noise model and of the width ε of Coulomb friction; none if the model allows
        deviations.
    mode
        The posterior mode, from which samplers start; None if nothing was fitted, or if the model allows deviations.
    sd_noise, sd_law
        If the model allows deviations: the part of the standard deviation that is due to the noise, and the part that
        is due to the deviations, by name (the two add in quadrature). Otherwise empty.
    deviation, frequency_deviation
        If the model allows deviations: median and 95 % interval of the energy-weighted mean over the record of |g − ḡ|
        and of |h − h̄|. g is the log deviation of the damping from its law, h is the relative deviation of the
        frequency, and ḡ and h̄ are their means. Otherwise None.
    law
        If the model allows deviations: the fit, linearised about the best motion, from which samplers start instead of
        `mode`. Otherwise None.
    """

    _STORED = StoredFit

    signal: Signal
    model: Model
    noise: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    sd: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    fitted: Vector = field(default_factory=lambda: _EMPTY)
    residuals: Vector = field(default_factory=lambda: _EMPTY)
    log_posterior: float = float("nan")
    outcome: str = types.OK
    notes: tuple[str, ...] = ()
    mode: Mode | None = None
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    sd_noise: Mapping[str, float] = field(default_factory=dict)
    sd_law: Mapping[str, float] = field(default_factory=dict)
    deviation: Quantity | None = None
    frequency_deviation: Quantity | None = None
    law: Single | None = field(default=None, repr=False)

    @cached_property
    def density(self) -> Density:
        """The posterior density as functions of the parameters. Raises Refusal with the outcome if there is no fit."""
        return Density.at(self.signal, self.model, self.engine[1])

    @property
    def target(self) -> Target | None:
        """The posterior from whose mode samplers start.

        None if nothing was fitted, or if the model allows deviations from its laws.
        """
        return None if self.mode is None else self.mode.likelihood.target

    @property
    def engine(self) -> tuple[Target, Mode]:
        """Two objects for samplers and evidence methods: the posterior (a `Target`), and its mode (a `Mode`).

        If the model allows deviations from its laws, they are integrated out. Raises Refusal with the text `outcome`,
        the reason, if there is no fit.
        """
        mode = self.mode if self.law is None else self.law.mode
        if mode is None:
            raise types.Refusal(self.outcome)
        return mode.likelihood.target, mode

    @property
    def priors(self) -> Mapping[str, Prior]:
        """The prior of each inferred parameter by name, including default priors; empty if nothing was fitted."""
        if self.law is not None:
            return self.law.state.priors
        return {} if self.target is None else self.target.priors

    @property
    def oscillator(self) -> Oscillator:
        """The oscillator that is fitted, with its damping terms and restoring law."""
        return Oscillator(self.model.terms, self.model.restoring)

    def damping_ratio(self, amplitudes: Sequence[float] | None = None) -> pd.DataFrame:
        """Return a table of equivalent damping ratios at several amplitudes, with their uncertainty.

        Columns: amplitude, unit (of the amplitude), value (median; a fraction), low and high (ends of the 95 %
        interval), sd_noise (part of the standard deviation that is due to noise) and sd_law (the other part, due to the
        deviation of the damping from its law and the linearity error of the sensor). The interval covers both. All
        numbers but the amplitude are NaN if the fitted oscillator cannot have this amplitude.

        Parameters
        ----------
        amplitudes
            Amplitudes in the file's unit of displacement (rad or m for a file in rpm or g), as in the table, which has
            a row for each in this order; by default three in the range of the record, the largest first.

        Raises
        ------
        InputError
            If an amplitude is above 1.3 times the first, or below 1/1.3 of the last amplitude of the record.
        Refusal
            If there is no fit; or if the model assumes exact laws, for which `sample(fit).derived` has the ratios.
        """
        return tabulate_ratios(self, amplitudes)

    def predict(self, t: ArrayLike, quantity: str | None = None) -> Prediction:
        """Predict the motion at given times.

        Parameters
        ----------
        t
            Times in s from the first sample: a number, or an array of any shape and order. They may be within the
            record, after it, or before it (negative). If the model allows deviations from its laws, they must be within
            the part of the record that was fitted, because the deviations are not known elsewhere.
        quantity
            "angle", "velocity" or "acceleration"; by default the recorded quantity.

        Returns
        -------
        Prediction
            The motion at the m times, in the given order (an array is flattened).

        Raises
        ------
        InputError
            If a time is not a finite number or is outside the range in which the motion is known, or the quantity is
            unknown.
        Refusal
            If there is no fit.
        """
        wanted = quantity or self.signal.quantity
        if wanted not in QUANTITIES:
            raise types.InputError(f"predict: unknown quantity {wanted!r}{nearest(wanted, list(QUANTITIES))}")
        times = numbers_of(t, "t", "predict").ravel()
        if not np.all(np.isfinite(times)):
            raise types.InputError(
                "predict: t must be finite times in s, counted from the first sample of the signal"
            )
        if self.law is not None:
            value, sd = predict_approximate(self.law, times, wanted)
        else:
            value, sd = predict_exact(*self.engine, self.signal, times, wanted)
        return Prediction(times, value, sd, wanted, types.UNITS[self.signal.unit].of(wanted))

    def summary(self) -> pd.DataFrame:
        """Return a table with a row for each inferred parameter: value, sd, 95 % interval, unit and prior.

        The columns are value, sd, low, high, unit and prior; the index contains the names. If the model allows
        deviations from its laws, the columns sd_noise and sd_law contain the parts of the sd that are due to the noise
        and to the deviations. Without a fit the table has no rows.
        """
        parts = {"sd_noise": self.sd_noise, "sd_law": self.sd_law} if self.law is not None else {}
        low, high = ({n: ends[i] for n, ends in self.intervals.items()} for i in (0, 1))
        priors = {n: self.priors[n].describe() for n in self.values}
        columns = {"value": self.values, "sd": self.sd, **parts, "low": low, "high": high, "unit": self.units}
        return data_frame({**columns, "prior": priors}, index=self.values)

    def plot(self, ax: GivenAxes = None, until: float | None = None) -> tuple[Axes, ...]:
        """Plot the record with the fit, and the residuals below.

        Parameters
        ----------
        ax
            Two axes; or one for the record with the fit, without residuals. By default two new ones.
        until
            Time in s from the first sample up to which the fit is extrapolated after the end of the record, with a band
            of ± 2 sd; by default it is not extrapolated.

        Returns
        -------
        tuple of Axes
            The axes of the record and, if drawn, of the residuals.

        Raises
        ------
        InputError
            If `ax` contains another number of axes, or if the fit is extrapolated although the model allows deviations
            from its laws.
        Refusal
            If there is no fit.
        """
        if not self.values:
            raise types.Refusal(self.outcome)
        alone = ax is not None and len(list_axes(ax)) == 1
        above, *rest = get_axes(ax, 1 if alone else 2, heights=(2, 1))
        t = self.signal.t
        end = float(t[-1]) if until is None else max(float(until), float(t[-1]))
        unit = self.signal.own_unit
        label, scale = unit.of(self.signal.quantity), unit.scale
        above.plot(t, self.signal.y * scale, ".", color=QUIET, ms=2, label="record")
        above.plot(t, self.fitted * scale, color=BLUE, lw=1.0, label=f"fit of {self.model.damping}")
        if end > t[-1]:
            ahead = self.predict(np.arange(float(t[-1]), end, float(np.median(np.diff(t)))))
            value, sd = ahead.value * scale, ahead.sd * scale
            above.plot(ahead.t, value, color=BLUE, lw=1.0, ls="--", label="beyond the record")
            low, high = value - 2 * sd, value + 2 * sd
            above.fill_between(ahead.t, low, high, color=BLUE, alpha=0.2, lw=0)
        above.set_ylabel(f"{unit.quantity_name(self.signal.quantity)} / {label}")
        above.legend(loc="upper right")
        for below in rest:
            below.plot(t, self.residuals * scale, color=BLUE, lw=0.6)
            below.axhline(0.0, color=QUIET, lw=0.6)
            below.set_ylabel(f"residual / {label}")
            below.set_xlim(above.get_xlim())
        (above, *rest)[-1].set_xlabel("time / s")
        return above, *rest

    def _table(self) -> Table:
        title = f"Fit of {self.model.name} to {self.signal.name}"
        if self.values:
            unit = self.signal.own_unit
            rms = float(np.sqrt(np.nanmean(self.residuals**2))) * unit.scale
            title += f": {self.noise} noise, residual {digits(rms, n=3)} {unit.of(self.signal.quantity)} rms"
        known = ", ".join(f"{n} = {digits(v, n=6)}" for n, v in self.known.items())
        deviates = tuple(
            f"No deviation of the {what} from its law is detected (95 %: below {percentage(q.high)} %)."
            if q.value < UNDETECTED_DEVIATION
            else f"The {what} follows its law within {percentage(q.value)} % (95 %: below {percentage(q.high)} %)."
            for what, q in (("damping", self.deviation), ("frequency", self.frequency_deviation))
            if q is not None
        )
        named = [f"Known: {known}."] if known else []
        notes = outcome_notes(self.outcome, (*named, *self.notes, *deviates))
        return frame_table(self.summary().drop(columns="prior"), title, notes)

    def _reduced(self) -> StoredFit:
        target = self.target
        return StoredFit(
            self.signal, self.model, self.noise, self.outcome, self.notes,
            priors=target.priors if target else {},
            known=target.known if target else {},
            mode=self.mode.stored if self.mode else None,
            law=self.law.state if self.law else None,
        )  # fmt: skip

    @classmethod
    def _restored(cls, stored: StoredFit) -> Self:
        signal, model = stored.signal, stored.model
        if stored.law is not None:
            return cls.at_law(signal, model, rebuild_single(signal, model.restoring, stored.law))
        if stored.mode is None:
            return cls(signal, model, outcome=stored.outcome, notes=stored.notes)
        oscillator = Oscillator(model.terms, model.restoring)
        target = Target(signal, oscillator, stored.noise, stored.priors, stored.known)
        return cls.at_mode(signal, model, restore_mode(target, stored.mode), stored.notes)

    @classmethod
    def at_mode(cls, signal: types.Signal, model: Model, mode: Mode, notes: tuple[str, ...] = ()) -> Self:
        """Create the fit of a model that assumes exact laws, from its posterior mode on a record.

        `notes` are sentences on the choice of the noise model and of the width ε of Coulomb friction.
        """
        target, left = mode.likelihood.target, mode.likelihood.residual(mode.z)
        density = Density.at(signal, model, mode)
        covariance = np.linalg.inv(mode.information)
        return cls(
            signal=Signal.of(signal),
            model=model,
            noise=target.noise,
            values=density.values,
            sd=value_sds(target, mode.z, covariance),
            intervals=value_intervals(target, mode.z, np.sqrt(np.diag(covariance))),
            units=density.units,
            known=dict(target.known),
            fitted=signal.y - left,
            residuals=left,
            log_posterior=density.log_prior(density.vector()) + mode.likelihood.log_noise(left, mode.z),
            notes=notes,
            mode=mode,
        )

    @classmethod
    def at_law(cls, signal: types.Signal, model: Model, law: Single) -> Self:
        """Create the fit of a model that allows deviations from its laws.

        `law` is the model on this record, linearised about its posterior mode.
        """
        quantities = law.quantities()
        times = signal.t - signal.t[0]
        used = times <= law.knots[-1]
        fitted = np.full(times.size, np.nan)
        fitted[used] = law.motions(law.best, times[used])[0]
        of_damping, of_frequency = (quantity(x) for x in law.sizes(law.scores))
        return cls(
            signal=Signal.of(signal),
            model=model,
            noise=law.comparison.noise.name,
            values={n: q.value for n, q in quantities.items()},
            sd={n: float(np.hypot(q.sd_noise, q.sd_law)) for n, q in quantities.items()},
            units=units_of(law.names, model.restoring, signal),
            known=law.known,
            fitted=fitted,
            residuals=signal.y - fitted,
            intervals={n: (q.low, q.high) for n, q in quantities.items()},
            sd_noise={n: q.sd_noise for n, q in quantities.items()},
            sd_law={n: q.sd_law for n, q in quantities.items()},
            deviation=of_damping,
            frequency_deviation=of_frequency,
            law=law,
        )


def fit(signal: types.Signal, model: Model, *, start: Mapping[str, float] | None = None) -> Fit:
    """Fit a model to a record.

    The model is first fitted by least squares, as in `compare`, to windows that grow from the first two cycles to the
    whole record. The search for the posterior mode starts from this fit and from `start`. If the model has several
    noise models, the one with the highest evidence under this model is chosen; those without a noise parameter that has
    a known value or a prior are left out.

    If the model allows deviations from its laws (`model.deviation`), `start` cannot be given. The noise model, and the
    width ε of Coulomb friction if it is not known, are then chosen as in `compare`, with viscous, Coulomb, quadratic
    and the model's other damping terms together.

    Parameters
    ----------
    signal
        The record.
    model
        The model.
    start
        A further starting point: parameter values by name, in base units (rad, m or the sensor's, and s), such as
        `values` of an `Estimate`.

    Returns
    -------
    Fit
        The fit. If the model cannot be fitted to this record, or if a model with deviations is far less probable than
        the larger sum of terms (above), its outcome is a sentence with the reason.

    Raises
    ------
    InputError
        If an argument is invalid, if the restoring law does not suit the unit of the record, or if an oscillator with
        the known parameters cannot oscillate about the record's midline.

    Examples
    --------
    >>> import bayesdamp as bd
    >>> signal = bd.simulate({"viscous": 0.05}, stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
    >>> model = bd.Model("viscous", noise="gaussian", known={"rest_angle": 0.0})
    >>> fit = bd.fit(signal, model)
    >>> abs(fit.values["zeta"] - 0.05) < 4 * fit.sd["zeta"]
    True
    >>> fit.units["zeta"]
    '1/s'
    """
    own = check_signal(signal, model)
    if model.approximate and start is not None:
        raise types.InputError(
            f"fit: start has no effect if the model has deviation {model.deviation!r}; call fit without start"
        )
    try:
        if model.approximate:
            return Fit.at_law(own, model, fit_approximate(own, model))
        mode, notes = fit_exact(own, model, start)
    except types.Refusal as refusal:
        return Fit(own, model, outcome=str(refusal))
    best = Fit.at_mode(own, model, mode, notes)
    poor = misfit(best.residuals, own, features(own)) if best.noise == GAUSSIAN else None
    return best if poor is None else replace(best, notes=(*notes, f"{poor[0].upper()}{poor[1:]}."))


def tabulate_ratios(
    fit: Fit, amplitudes: Sequence[float] | None = None, u: Vector | None = None
) -> pd.DataFrame:
    """Return a table of equivalent damping ratios at several amplitudes, with the columns of `Fit.damping_ratio`.

    `amplitudes` are as in `Fit.damping_ratio`, and so are the errors that are raised. `u`, (n, K), contains n draws of
    the parameters (as standard normal scores) and of the deviations from the laws, as `Posterior.u` with the chains
    joined. By default, draws from the linear approximation of the fit are used.
    """
    if fit.law is None:
        raise types.Refusal(NO_RATIO_TABLE if fit.outcome == types.OK else fit.outcome)
    comparison, own = fit.law.comparison, fit.signal.own_unit.displacement
    given = amplitudes_in_base_unit(amplitudes, comparison, fit.signal.own_unit)
    wanted = given or default_amplitudes(comparison)
    ratios = fit.law.ratios(wanted, fit.law.scores if u is None else u, fit.model.sensor)
    table = data_frame(map(asdict, ratios))
    table["amplitude"] *= own.scale
    table.insert(1, "unit", own.name)
    return table


def predict_exact(
    target: Target, mode: Mode, signal: Signal, times: Vector, wanted: str
) -> tuple[Vector, Vector]:
    """Predict the motion of the best fit and its standard deviation, for a model that assumes exact laws.

    times: (m,), in s from the first sample, within the record, after it, or before it. wanted: the quantity to predict,
    "angle", "velocity" or "acceleration". The standard deviation does not include the noise. Both results are (m,), in
    the base unit of the quantity.
    """
    derivatives = QUANTITIES.index(wanted) - QUANTITIES.index(signal.quantity)
    precision = PRECISION * float(np.ptp(signal.y)) * features(signal).frequency ** derivatives
    osc, best = target.oscillator, target.all_values(mode.z)
    z = laplace_draws(mode, BAND_DRAWS, 0)
    drawn = {**{n: np.full(BAND_DRAWS, float(v)) for n, v in target.known.items()}, **target.values(z)}
    value, sd = np.empty(times.size), np.empty(times.size)
    for chosen, way in ((times >= 0, 1.0), (times < 0, -1.0)):
        if not chosen.any():
            continue
        # Times before the record are computed with reversed time, in which velocities and damping change their sign.
        signs = {n: way for n in (*osc.coefficients, "omega0")}
        single = {n: v * signs.get(n, 1.0) for n, v in best.items()}
        many = {n: v * signs.get(n, 1.0) for n, v in drawn.items()}
        grid, at = np.unique(np.concatenate([[0.0], way * times[chosen]]), return_inverse=True)
        motion = Trajectories(osc, grid, wanted, single, precision)
        value[chosen] = (way if wanted == "velocity" else 1.0) * motion.record(single)[at[1:]]
        sd[chosen] = motion.many(many).std(axis=0)[at[1:]]
    return value, sd


def predict_approximate(law: Single, times: Vector, wanted: str) -> tuple[Vector, Vector]:
    """Predict the motion of the best fit and its standard deviation, for a model that allows deviations from its laws.

    times: (m,), in s from the first sample. wanted: the quantity to predict, "angle", "velocity" or "acceleration".
    The standard deviation does not include the noise. Both results are (m,), in the base unit of the quantity. Raises
    InputError if a time is outside the part of the record that was fitted.
    """
    end = float(law.knots[-1])
    if not times.size:
        return times, times
    if times.min() < 0 or times.max() > end:
        raise types.InputError(
            f"predict: t goes from {times.min():.6g} to {times.max():.6g} s, but the fit covers 0 to {end:.6g} s, and "
            'the deviations from the law are not known elsewhere; use a Model with deviation="none" to extrapolate'
        )
    grid, at = np.unique(times, return_inverse=True)
    drawn = np.concatenate([law.best, law.scores[:: len(law.scores) // BAND_DRAWS]])
    motions = law.motions(drawn, grid, wanted)
    return motions[0][at], np.nanstd(motions[1:], axis=0)[at]
