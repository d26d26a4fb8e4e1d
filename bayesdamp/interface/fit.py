"""Fit a model to a record: the best fit, the normal distribution about it, and the motion at other times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayesdamp import types
from bayesdamp.formatting import Table, compact
from bayesdamp.inference.checks import laplace_draws
from bayesdamp.inference.deviation.draws import Quantity, quantity
from bayesdamp.inference.deviation.findings import default_amplitudes
from bayesdamp.inference.deviation.single import FitState, Single, rebuild_single
from bayesdamp.inference.mode import Mode, StoredMode, restore_mode, value_intervals, value_sds
from bayesdamp.inference.model.target import Target
from bayesdamp.interface.answer import in_base
from bayesdamp.interface.arguments import numbers_of
from bayesdamp.interface.density import Density, units_of
from bayesdamp.interface.model import Model, check_signal, fit_approximate, fit_exact
from bayesdamp.interface.result import BLUE, FAINT, QUIET, Result, get_axes, list_axes, outcome_notes
from bayesdamp.interface.signal import Signal
from bayesdamp.physics.kernel.solve import QUANTITIES
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import Trajectories
from bayesdamp.plugins import nearest
from bayesdamp.priors import Prior
from bayesdamp.records.oscillation.features import features
from bayesdamp.serial import Reduced
from bayesdamp.types import OK, InputError, Refusal
from bayesdamp.units import UNITS
from bayesdamp.verdict.words import UNSEEN

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from bayesdamp.interface.result import GivenAxes

Vector = NDArray[np.float64]
EXACT = 'laws hold exactly in this fit: use sample(fit).derived, or give deviation="law"'
_EMPTY = np.empty(0)
BAND = 200
"""Draws for the standard deviation of a prediction, which is then good to a twentieth of itself."""
PRECISION = 1e-6
"""Precision of a predicted motion, as a share of the record's range."""
SHOWN = 8
"""Largest number of times in a printed prediction."""
TWO_SIDED = 1.96
"""Half width of a 95 % band in standard deviations."""


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Result):
    """A motion at given times.

    Attributes
    ----------
    t
        Times in s, shape (m,).
    value, sd
        Motion at the best fit, and its standard deviation from the parameters' uncertainty without the noise, each of
        shape (m,), in `unit`.
    quantity, unit
        What is predicted, and its unit.
    """

    t: Vector
    value: Vector
    sd: Vector
    quantity: str
    unit: str

    def summary(self) -> pd.DataFrame:
        """Return a row for each time: t in s, value and sd in `unit`."""
        import pandas as pd

        return pd.DataFrame({"t": self.t, "value": self.value, "sd": self.sd, "unit": self.unit})

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the motion with its 95 % band, and return the axes."""
        ax = get_axes(ax)[0]
        order = np.argsort(self.t)
        t, value, half = self.t[order], self.value[order], TWO_SIDED * self.sd[order]
        ax.fill_between(t, value - half, value + half, color=FAINT, label="95 %")
        ax.plot(t, value, color=BLUE, lw=1.0, label="best fit")
        ax.set_xlabel("time / s")
        ax.set_ylabel(f"{self.quantity} / {self.unit}")
        ax.legend(loc="upper right")
        return ax

    def _table(self) -> Table:
        some = np.unique(np.linspace(0, self.t.size - 1, min(SHOWN, self.t.size)).astype(int))
        columns = (self.t[some].tolist(), self.value[some].tolist(), self.sd[some].tolist())
        rows = tuple((compact(t), compact(v, 5), compact(sd, 2)) for t, v, sd in zip(*columns, strict=True))
        notes = (f"{some.size} of {self.t.size} times",) if some.size < self.t.size else ()
        heads = ("time / s", f"{self.quantity} / {self.unit}", "sd")
        return Table(heads, rows, caption="Predicted motion", notes=notes)


@dataclass(frozen=True)
class StoredFit:
    """The content of a file for a fit: its arguments, and where the searches ended."""

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
class Fit(Result, Reduced):
    """The best fit of a model to a record.

    It is the mode of the posterior density of the parameters' scores, in which every prior is a standard normal.

    Where laws may hold approximately (model.deviation), values are medians under the model that is linear about the
    best motion, with deviations integrated out, and sd is the total standard deviation.

    Attributes
    ----------
    signal, model
        The record and the model.
    noise
        The noise model, as given or as chosen for the record.
    values, units
        Inferred parameters in natural units, and their units, by name; empty without a fit.
    sd, intervals
        Standard deviation of each parameter in the normal distribution about the mode, and its 95 % interval
        (low, high), by name.
    known
        Parameters that were not inferred, by name.
    fitted, residuals
        Trajectory, and record minus trajectory, in the unit of the record, each of shape (n,). Where laws may hold
        approximately, the trajectory includes the deviations of the best motion, and is NaN where the record is not
        used (below 5 % of its first amplitude).
    log_posterior
        Log prior plus log likelihood of the values in nats, per natural units, not normalised; NaN where laws may hold
        approximately.
    outcome
        "ok", or a sentence why there is no fit.
    notes
        Sentences on what was chosen.
    target, mode
        What samplers start from; None without a fit, and where laws may hold approximately.
    sd_noise, sd_law
        Where laws may hold approximately: the standard deviation from the noise alone, and the rest.
    deviation, frequency_deviation
        Where laws may hold approximately: relative deviations of damping and frequency from their laws, mean over the
        record.
    law
        Where laws may hold approximately: the fit in place of target and mode.
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
    outcome: str = OK
    notes: tuple[str, ...] = ()
    target: Target | None = None
    mode: Mode | None = None
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    sd_noise: Mapping[str, float] = field(default_factory=dict)
    sd_law: Mapping[str, float] = field(default_factory=dict)
    deviation: Quantity | None = None
    frequency_deviation: Quantity | None = None
    law: Single | None = field(default=None, repr=False)

    @cached_property
    def density(self) -> Density:
        """The posterior as plain functions. Raises Refusal, with the outcome, without a fit."""
        return Density.at(self.signal, self.model, self.engine[1])

    @property
    def engine(self) -> tuple[Target, Mode]:
        """The target and its mode; where laws may hold approximately, with deviations integrated out.

        Raises Refusal, with the outcome, without a fit.
        """
        if self.law is not None:
            return self.law.mode.likelihood.target, self.law.mode
        if self.target is None or self.mode is None:
            raise Refusal(self.outcome)
        return self.target, self.mode

    @property
    def priors(self) -> Mapping[str, Prior]:
        """The prior of each inferred parameter, defaults filled in; empty without a fit."""
        if self.law is not None:
            return self.law.state.priors
        return {} if self.target is None else self.target.priors

    @property
    def oscillator(self) -> Oscillator:
        """Damping and restoring law that are fitted."""
        return Oscillator(self.model.terms, self.model.restoring)

    def damping_ratio(self, amplitudes: Sequence[float] | None = None) -> pd.DataFrame:
        """Return the equivalent damping ratio at amplitudes, with the parts of its sd and its 95 % interval.

        It includes the law's deviation and the sensor's linearity.

        Parameters
        ----------
        amplitudes
            In the unit that the record came in; by default three of the record.

        Raises
        ------
        Refusal
            Without a fit, and where laws hold exactly: `sample(fit).derived` has the ratio there.
        """
        return tabulate_ratios(self, amplitudes)

    def predict(self, t: ArrayLike, quantity: str | None = None) -> Prediction:
        """Return the motion at given times.

        Parameters
        ----------
        t
            Times in s from the first sample: a number, or an array of any shape and order. They may be within the
            record, after it, or before it (negative); where laws may hold approximately only within it, because it is
            not known how they deviate elsewhere.
        quantity
            "angle", "velocity" or "acceleration"; by default the recorded one.

        Returns
        -------
        Prediction
            The motion at the times, shape (m,).

        Raises
        ------
        InputError
            For times that are not numbers, or where the motion is not known.
        Refusal
            Without a fit.
        """
        wanted = quantity or self.signal.quantity
        times = check_times(t, wanted)
        if self.law is not None:
            return predict_approximate(self.law, self.signal, times, wanted)
        return predict_exact(*self.engine, self.signal, times, wanted)

    def summary(self) -> pd.DataFrame:
        """Return a row for each inferred parameter: value, sd, 95 % interval, unit and prior.

        Where laws may hold approximately also the parts of the sd.
        """
        import pandas as pd

        columns = ["value", "sd", *(["sd_noise", "sd_law"] if self.law is not None else []), "low", "high"]
        rows = {
            n: {
                "value": v,
                "sd": self.sd[n],
                "sd_noise": self.sd_noise.get(n),
                "sd_law": self.sd_law.get(n),
                "low": self.intervals[n][0],
                "high": self.intervals[n][1],
                "unit": self.units[n],
                "prior": self.priors[n].describe(),
            }
            for n, v in self.values.items()
        }
        return pd.DataFrame.from_dict(rows, orient="index", columns=[*columns, "unit", "prior"])

    def plot(self, ax: GivenAxes = None, until: float | None = None) -> tuple[Axes, ...]:
        """Draw the record with the fit, and the residuals below.

        Parameters
        ----------
        ax
            Two axes, or one for the record with the fit alone; new ones by default.
        until
            Time in s up to which the fit is continued after the record.

        Returns
        -------
        tuple of Axes
            The axes.

        Raises
        ------
        InputError
            For another number of axes.
        Refusal
            Without a fit.
        """
        if not self.values:
            raise Refusal(self.outcome)
        alone = ax is not None and len(list_axes(ax)) == 1
        above, *rest = get_axes(ax, 1 if alone else 2, heights=(2, 1))
        t = self.signal.t
        end = float(t[-1]) if until is None else max(float(until), float(t[-1]))
        unit = self.signal.own_unit
        label, scale = unit.of(self.signal.quantity), unit.scale
        above.plot(t, self.signal.y * scale, ".", color=QUIET, ms=2, label="record")
        above.plot(t, self.fitted * scale, color=BLUE, lw=1.0, label=f"fit of {self.model.damping}")
        if end > t[-1]:
            gap = float(np.median(np.diff(t)))
            ahead = self.predict(np.arange(float(t[-1]), end, gap))
            value, sd = ahead.value * scale, ahead.sd * scale
            above.plot(ahead.t, value, color=BLUE, lw=1.0, ls="--", label="beyond the record")
            low, high = value - 2 * sd, value + 2 * sd
            above.fill_between(ahead.t, low, high, color=BLUE, alpha=0.2, lw=0)
        above.set_ylabel(f"{unit.called(self.signal.quantity)} / {label}")
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
            title += f": {self.noise} noise, residual {compact(rms, 3)} {unit.of(self.signal.quantity)} rms"
        approximate = self.law is not None
        parts = (self.sd_noise, self.sd_law) if approximate else (self.sd,)
        spreads = ("sd noise", "sd law", "95 %") if approximate else ("sd",)
        rows = [
            (n, self.units[n], compact(v, 6), *(compact(p[n], 2) for p in parts))
            for n, v in self.values.items()
        ]
        if approximate:
            ends = [f"{compact(low, 4)} to {compact(high, 4)}" for low, high in self.intervals.values()]
            rows = [(*row, end) for row, end in zip(rows, ends, strict=True)]
        empty = ("",) * (len(spreads) - 1)
        rows += [(n, "", compact(v, 6), "known", *empty) for n, v in self.known.items()]
        both = (("damping", self.deviation), ("frequency", self.frequency_deviation))
        deviates = tuple(
            f"No deviation of the {what} from its law is detected (95 %: below {100 * q.high:.2g} %)."
            if q.value < UNSEEN
            else f"The {what} follows its law within {100 * q.value:.2g} % (95 %: below {100 * q.high:.2g} %)."
            for what, q in both
            if q is not None
        )
        notes = outcome_notes(self.outcome, (*self.notes, *deviates))
        return Table(("parameter", "unit", "value", *spreads), rows, caption=title, notes=notes)

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
        """Return the fit whose mode is given, where laws hold exactly; notes: on what was chosen for it."""
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
            target=target,
            mode=mode,
        )

    @classmethod
    def at_law(cls, signal: types.Signal, model: Model, law: Single) -> Self:
        """Return the fit at the end of a search for the motion, where laws may hold approximately."""
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


def fit(
    signal: types.Signal, model: Model, *, start: Mapping[str, float] | None = None, seed: int = 0
) -> Fit:
    """Fit a model to a record.

    Searches start from the record's turning points, a regression, two draws of the prior, and `start`. Where several
    noise models are possible, the one with the highest evidence under this model is chosen.

    Where laws may hold approximately (model.deviation) the search is that of `compare`, over windows that grow from the
    first two cycles, without a start. The noise, and the width of friction where it is not known, are then those under
    viscous, Coulomb and quadratic damping together.

    Parameters
    ----------
    signal
        The record.
    model
        The model.
    start
        Parameter values by name, such as those of an estimate.
    seed
        Seed of the draws.

    Returns
    -------
    Fit
        Where the model cannot be fitted to this record, its outcome is a sentence.

    Raises
    ------
    InputError
        For a wrong argument.

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
        raise InputError(f"fit: start has no effect under deviation {model.deviation!r}; remove it")
    try:
        if model.approximate:
            return Fit.at_law(own, model, fit_approximate(own, model))
        mode, notes = fit_exact(own, model, start, seed)
    except Refusal as refusal:
        return Fit(own, model, outcome=str(refusal))
    return Fit.at_mode(own, model, mode, notes)


def tabulate_ratios(
    fit: Fit, amplitudes: Sequence[float] | None = None, u: Vector | None = None
) -> pd.DataFrame:
    """Return `Fit.damping_ratio` of draws with their deviations, u (n, K), by default of the linear model's."""
    import pandas as pd

    if fit.law is None:
        raise Refusal(EXACT if fit.outcome == OK else fit.outcome)
    comparison, own = fit.law.comparison, fit.signal.own_unit.displacement
    wanted = in_base(amplitudes, comparison, fit.signal.own_unit) or default_amplitudes(comparison)
    rows = [
        {**asdict(r), "amplitude": r.amplitude * own.scale, "unit": own.name}
        for r in fit.law.ratios(wanted, fit.law.scores if u is None else u, fit.model.sensor)
    ]
    columns = ["amplitude", "unit", *(name for name in rows[0] if name not in ("amplitude", "unit"))]
    return pd.DataFrame(rows, columns=columns)


def check_times(t: ArrayLike, quantity: str) -> Vector:
    """Return times, (m,), from an array of any shape or a number. Raises InputError for wrong times or quantity."""
    if quantity not in QUANTITIES:
        raise InputError(f"predict: unknown quantity {quantity!r}{nearest(quantity, list(QUANTITIES))}")
    times = numbers_of(t, "t", "predict").ravel()
    if not np.all(np.isfinite(times)):
        raise InputError("predict: t must be finite times, in s from the first sample")
    return times


def predict_exact(target: Target, mode: Mode, signal: Signal, times: Vector, wanted: str) -> Prediction:
    """Predict where laws hold exactly: at times (m,) within the record, after it, or before it."""
    derivatives = QUANTITIES.index(wanted) - QUANTITIES.index(signal.quantity)
    precision = PRECISION * float(np.ptp(signal.y)) * features(signal).frequency ** derivatives
    osc, best = target.oscillator, target.all_values(mode.z)
    z = laplace_draws(target, mode, BAND, 0)
    drawn = {**{n: np.full(BAND, float(v)) for n, v in target.known.items()}, **target.values(z)}
    value, sd = np.empty(times.size), np.empty(times.size)
    for chosen, way in ((times >= 0, 1.0), (times < 0, -1.0)):
        if not chosen.any():
            continue
        # With reversed time, forces that are odd in the velocity change their sign, and so do velocities.
        signs = {n: way for n in (*osc.coefficients, "omega0")}
        single = {n: v * signs.get(n, 1.0) for n, v in best.items()}
        many = {n: v * signs.get(n, 1.0) for n, v in drawn.items()}
        grid, at = np.unique(np.concatenate([[0.0], way * times[chosen]]), return_inverse=True)
        motion = Trajectories(osc, grid, wanted, single, precision)
        value[chosen] = (way if wanted == "velocity" else 1.0) * motion.record(single)[at[1:]]
        sd[chosen] = motion.many(many).std(axis=0)[at[1:]]
    return Prediction(times, value, sd, wanted, UNITS[signal.unit].of(wanted))


def predict_approximate(law: Single, signal: Signal, times: Vector, wanted: str) -> Prediction:
    """Predict where laws hold approximately: in the part of the record that was fitted. Raises InputError outside."""
    end = float(law.knots[-1])
    if not times.size:
        return Prediction(times, times, times, wanted, UNITS[signal.unit].of(wanted))
    if times.min() < 0 or times.max() > end:
        raise InputError(
            f"predict: t goes from {times.min():.6g} to {times.max():.6g} s; the fit covers 0 to {end:.6g} s, and how "
            'the law deviates elsewhere is not known; use deviation="none" to extrapolate'
        )
    grid, at = np.unique(times, return_inverse=True)
    motions = law.motions(np.concatenate([law.best, law.scores[:: len(law.scores) // BAND]]), grid, wanted)
    band = np.nanstd(motions[1:], axis=0)
    return Prediction(times, motions[0][at], band[at], wanted, UNITS[signal.unit].of(wanted))
