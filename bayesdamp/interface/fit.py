"""The best fit of a model to a record, and the normal distribution about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayesdamp import types
from bayesdamp.formatting import compact
from bayesdamp.inference.deviation.findings import default_amplitudes
from bayesdamp.inference.deviation.numbers.draws import Quantity, quantity
from bayesdamp.inference.deviation.single import Found, Single, put_together
from bayesdamp.inference.fit.mode import Mode, StoredMode, restore_mode, value_intervals, value_sds
from bayesdamp.inference.model.target import Target
from bayesdamp.interface.answer import in_base
from bayesdamp.interface.density import Density
from bayesdamp.interface.fitting.case import Case
from bayesdamp.interface.fitting.search import checked, deviating, searched
from bayesdamp.interface.model import Model
from bayesdamp.interface.parts import axes as drawing
from bayesdamp.interface.parts.definitions import units_of
from bayesdamp.interface.parts.result import Result, outcome_notes
from bayesdamp.interface.prediction import Prediction, anywhere, asked_motion, within_record
from bayesdamp.interface.records.signal import Signal
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import Prior
from bayesdamp.serial import Reduced
from bayesdamp.table import Table
from bayesdamp.types import OK, InputError, Refusal
from bayesdamp.verdict.words import UNSEEN

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

Vector = NDArray[np.float64]
EXACT = (
    'laws are taken to hold exactly: draws have the ratio, in sample(fit).derived; or give deviation="law"'
)
_EMPTY = np.empty(0)


@dataclass(frozen=True)
class StoredFit:
    """What a file holds of a fit: its question, and where the searches ended."""

    signal: Signal
    model: Model
    noise: str
    outcome: str
    notes: tuple[str, ...]
    priors: Mapping[str, Prior]
    known: Mapping[str, float]
    mode: StoredMode | None
    law: Found | None


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Result, Reduced):
    """The mode of a posterior: of the density of the parameters' scores, in which every prior is a standard normal.

    noise: the noise model, as given or as chosen for the record. values, sd, units: of each inferred parameter, in
    natural units; sd is that of the normal distribution about the mode. intervals: of 95 %, (low, high), by name.
    known: all that was held, by name.
    fitted, residuals: trajectory, and record minus it, in the unit of the record, shape (n,).
    log_posterior: log prior plus log likelihood of the values (nats, per natural units, not normalised).
    outcome: "ok", or a sentence why there is no fit; then values are empty. notes: what was chosen, in sentences.
    target, mode: what samplers start from; None without a fit.

    Where laws may hold approximately (model.deviation) values are medians under the model that is linear about the best
    motion, deviations integrated out; sd is the whole, sd_noise what noise alone would leave, sd_law the rest, and
    intervals are the ones to quote. deviation, frequency_deviation: by how much damping and frequency differ from their
    laws, as shares, mean over the record. fitted has the deviations of the best motion in it, and is nan where the
    record is not read (below 5 % of its first amplitude). log_posterior is nan, target and mode None: law is there
    in their place.
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
        target, mode = self.engine
        return Density.at(self.signal, self.model, target, mode)

    @property
    def engine(self) -> tuple[Target, Mode]:
        """The target and its mode; where laws may hold approximately, deviations are integrated out. Raises Refusal,
        with the outcome, without a fit."""
        if self.law is not None:
            return self.law.mode.likelihood.target, self.law.mode
        if self.target is None or self.mode is None:
            raise Refusal(self.outcome)
        return self.target, self.mode

    @property
    def priors(self) -> Mapping[str, Prior]:
        """Of each inferred parameter, defaults filled in; empty without a fit."""
        if self.law is not None:
            return self.law.found.priors
        return {} if self.target is None else self.target.priors

    @property
    def oscillator(self) -> Oscillator:
        """Damping and restoring law that are fitted."""
        return Oscillator(self.model.terms, self.model.restoring)

    def damping_ratio(self, amplitudes: Sequence[float] | None = None) -> pd.DataFrame:
        """Equivalent damping ratio at amplitudes (in the unit that the record came in; three of the record by default),
        with its parts and 95 % interval, in which are the law's deviation and the sensor's linearity. Raises Refusal
        where laws are taken to hold exactly: there draws have it, as `sample(fit).derived`, and without a fit."""
        return self._damping_ratio(amplitudes, None)

    def _damping_ratio(self, amplitudes: Sequence[float] | None, u: Vector | None) -> pd.DataFrame:
        """The same of draws with their deviations, (n, K); by default of the linear model's."""
        import pandas as pd

        if self.law is None:
            raise Refusal(EXACT if self.outcome == OK else self.outcome)
        weighing, own = self.law.weighing, self.signal.own_unit.displacement
        wanted = in_base(amplitudes, weighing, self.signal.own_unit) or default_amplitudes(weighing)
        rows = [
            {**asdict(r), "amplitude": r.amplitude * own.scale, "unit": own.name}
            for r in self.law.ratios(wanted, self.law.scores if u is None else u, self.model.sensor)
        ]
        columns = ["amplitude", "unit", *(name for name in rows[0] if name not in ("amplitude", "unit"))]
        return pd.DataFrame(rows, columns=columns)

    def predict(self, t: ArrayLike, quantity: str | None = None) -> Prediction:
        """Return the motion at times t (s from the first sample): a number or an array of any shape and order, which
        the prediction has in a row, (m,).

        Times may be within the record, beyond it, or before it (negative); where laws may hold approximately only
        within it, as it is not known how they deviate elsewhere.

        quantity: "angle", "velocity" or "acceleration"; by default the recorded one. Raises InputError for times that
        are not numbers or outside of what is known, Refusal without a fit.
        """
        times, wanted = asked_motion(t, quantity or self.signal.quantity)
        if self.law is not None:
            return within_record(self.law, self.signal, times, wanted)
        return anywhere(*self.engine, self.signal, times, wanted)

    def summary(self) -> pd.DataFrame:
        """A row for each inferred parameter: value, sd (and its parts where laws may hold approximately), the 95 %
        interval, unit, prior."""
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

    def plot(self, ax: drawing.Given = None, until: float | None = None) -> tuple[Axes, ...]:
        """Draw the record with the fit, and the residuals below; the two axes drawn on.

        ax: two, or one for the record with the fit alone. until: time in s up to which the fit goes on beyond the
        record. Raises Refusal without a fit, InputError for other axes.
        """
        if not self.values:
            raise Refusal(self.outcome)
        alone = ax is not None and len(drawing.listed(ax)) == 1
        above, *rest = drawing.several(ax, 1 if alone else 2, heights=(2, 1))
        t = self.signal.t
        end = float(t[-1]) if until is None else max(float(until), float(t[-1]))
        unit = self.signal.own_unit
        label, scale = unit.of(self.signal.quantity), unit.scale
        above.plot(t, self.signal.y * scale, ".", color=drawing.QUIET, ms=2, label="record")
        above.plot(t, self.fitted * scale, color=drawing.BLUE, lw=1.0, label=f"fit of {self.model.damping}")
        if end > t[-1]:
            gap = float(np.median(np.diff(t)))
            ahead = self.predict(np.arange(float(t[-1]), end, gap))
            value, sd = ahead.value * scale, ahead.sd * scale
            above.plot(ahead.t, value, color=drawing.BLUE, lw=1.0, ls="--", label="beyond the record")
            low, high = value - 2 * sd, value + 2 * sd
            above.fill_between(ahead.t, low, high, color=drawing.BLUE, alpha=0.2, lw=0)
        above.set_ylabel(f"{unit.called(self.signal.quantity)} / {label}")
        above.legend(loc="upper right")
        for below in rest:
            below.plot(t, self.residuals * scale, color=drawing.BLUE, lw=0.6)
            below.axhline(0.0, color=drawing.QUIET, lw=0.6)
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
            f"No deviation of the {what} from its law is seen (95 %: below {100 * q.high:.2g} %)."
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
            law=self.law.found if self.law else None,
        )  # fmt: skip

    @classmethod
    def _restored(cls, stored: StoredFit) -> Self:
        signal, model = stored.signal, stored.model
        if stored.law is not None:
            return cls._approximated(signal, model, put_together(signal, model.restoring, stored.law))
        if stored.mode is None:
            return cls(signal, model, outcome=stored.outcome, notes=stored.notes)
        oscillator = Oscillator(model.terms, model.restoring)
        target = Target(signal, oscillator, stored.noise, stored.priors, stored.known)
        mode = restore_mode(target, stored.mode)
        return cls._solved(signal, model, target, mode, stored.outcome, stored.notes)

    @classmethod
    def _solved(
        cls, signal: Signal, model: Model, target: Target, mode: Mode, outcome: str, notes: tuple[str, ...]
    ) -> Self:
        left = mode.likelihood.residual(mode.z)
        density = Density.at(signal, model, target, mode)
        covariance = np.linalg.inv(mode.information)
        return cls(
            signal=signal,
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
            outcome=outcome,
            notes=notes,
            target=target,
            mode=mode,
        )

    @classmethod
    def _approximated(cls, signal: Signal, model: Model, law: Single) -> Self:
        found = law.quantities()
        times = signal.t - signal.t[0]
        read = times <= law.knots[-1]
        fitted = np.full(times.size, np.nan)
        fitted[read] = law.motions(law.best, times[read])[0]
        of_damping, of_frequency = (quantity(x) for x in law.sizes(law.scores))
        sd = {n: float(np.hypot(q.sd_noise, q.sd_law)) for n, q in found.items()}
        return cls(
            signal=signal,
            model=model,
            noise=law.weighing.noise.name,
            values={n: q.value for n, q in found.items()},
            sd=sd,
            units=units_of(law.names, model.restoring, signal),
            known=law.known,
            fitted=fitted,
            residuals=signal.y - fitted,
            intervals={n: (q.low, q.high) for n, q in found.items()},
            sd_noise={n: q.sd_noise for n, q in found.items()},
            sd_law={n: q.sd_law for n, q in found.items()},
            deviation=of_damping,
            frequency_deviation=of_frequency,
            law=law,
        )


def fit(
    signal: types.Signal, model: Model, *, start: Mapping[str, float] | None = None, seed: int = 0
) -> Fit:
    """The best fit of a model to a record.

    Searches start from what the record's turning points and a regression say, from two draws of the prior, and from
    start: parameter values by name, such as those of an estimate. With several noise models in play, the one of highest
    evidence is chosen under this model. seed: of the draws. Where the model cannot be fitted to this record the
    result's outcome is a sentence. Raises InputError for misuse.

    Where laws may hold approximately (model.deviation) the search is that of `compare`, over windows that grow from the
    first two cycles, and takes no start; noise, and friction's width where it is not known, are those under all of
    viscous, Coulomb and quadratic damping.

    >>> import bayesdamp as bd
    >>> signal = bd.simulate({"viscous": 0.05}, stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
    >>> model = bd.Model("viscous", noise="gaussian", known={"rest_angle": 0.0})
    >>> found = bd.fit(signal, model)
    >>> abs(found.values["zeta"] - 0.05) < 4 * found.sd["zeta"]
    True
    >>> found.units["zeta"]
    '1/s'
    """
    own = checked(signal, model)
    if model.approximate and start is not None:
        raise InputError(f"fit: start is of no use under deviation {model.deviation!r}; leave it out")
    try:
        case = Case.with_noise(own, model)
        if model.approximate:
            return Fit._approximated(own, model, deviating(case, model))
        target, mode, notes = searched(case, model, start, seed)
    except Refusal as refusal:
        return Fit(own, model, outcome=str(refusal))
    return Fit._solved(own, model, target, mode, OK, notes)
