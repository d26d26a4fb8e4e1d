"""The best fit of a model to a record, and the normal distribution about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayesdamp import types
from bayesdamp.inference.checks.checks import laplace_draws
from bayesdamp.inference.fit.laplace import value_sds
from bayesdamp.inference.fit.mode import Mode, restore_mode
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.fit.seeds import prior_seeds
from bayesdamp.inference.model.residuals import residual
from bayesdamp.inference.model.target import Target
from bayesdamp.interface.density import Density
from bayesdamp.interface.model import Model, prior_of
from bayesdamp.interface.parts import axes as drawing
from bayesdamp.interface.parts.case import NO_POSTERIOR, Case, checked, choose
from bayesdamp.interface.parts.definitions import units_of
from bayesdamp.interface.parts.programs import keep_programs
from bayesdamp.interface.parts.result import Packed, Result
from bayesdamp.interface.parts.table import Table, number, said
from bayesdamp.interface.records.signal import Signal
from bayesdamp.physics.integrate import make_plan
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.solver.plan import QUANTITIES
from bayesdamp.pipeline.records.climbs import packed as packed_mode
from bayesdamp.pipeline.records.climbs import unpacked as unpacked_mode
from bayesdamp.plugins import nearest
from bayesdamp.records.oscillation.features import features
from bayesdamp.store import CellResult
from bayesdamp.types import OK, InputError, Refusal
from bayesdamp.units import UNITS

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

Vector = NDArray[np.float64]
PRIOR_STARTS = 2
"""Draws from the prior that are climbed from beside what the record says."""
BAND = 200
"""Draws behind a prediction's standard deviation, which they make good to a twentieth of itself."""
PRECISION = 1e-6
"""Of a predicted motion, as a share of the record's range."""
_EMPTY = np.empty(0)


@dataclass(frozen=True, eq=False)
class Prediction:
    """A motion at times t (s, shape (m,)): value at the best fit, and the sd that the parameters' uncertainty gives it
    (noise not included), both (m,), in `unit`."""

    t: Vector
    value: Vector
    sd: Vector
    quantity: str
    unit: str


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Result):
    """The mode of a posterior: of the density of the parameters' scores, in which every prior is a standard normal.

    noise: the noise model, as given or as chosen for the record. values, sd, units: of each inferred parameter, in
    natural units; sd is that of the normal distribution about the mode. known: all that was held, by name.
    fitted, residuals: trajectory, and record minus it, in the unit of the record, shape (n,).
    log_posterior: log prior plus log likelihood of the values (nats, per natural units, not normalised).
    outcome: "ok", or a sentence why there is no fit; then values are empty. notes: what was chosen, in sentences.
    target, mode: what samplers start from; None without a fit.
    """

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

    @cached_property
    def density(self) -> Density:
        """The posterior as plain functions. Raises Refusal, with the outcome, without a fit."""
        target, mode = self.engine
        return Density(self.signal, self.model, self.values, self.units, target, mode)

    @property
    def engine(self) -> tuple[Target, Mode]:
        """The target and its mode. Raises Refusal, with the outcome, without a fit."""
        if self.target is None or self.mode is None:
            raise Refusal(self.outcome)
        return self.target, self.mode

    def predict(self, t: ArrayLike, quantity: str | None = None) -> Prediction:
        """The motion at times t (s from the first sample, shape (m,)), within the record or beyond it.

        quantity: "angle", "velocity" or "acceleration"; by default the recorded one. Raises InputError for times before
        the first sample, Refusal without a fit.
        """
        target, mode = self.engine
        times = np.atleast_1d(np.array(t, float))
        wanted = quantity or self.signal.quantity
        if wanted not in QUANTITIES:
            raise InputError(f"predict: unknown quantity {wanted!r}{nearest(wanted, list(QUANTITIES))}")
        if times.ndim != 1 or not np.all(np.isfinite(times)) or np.any(times < 0):
            raise InputError("predict: t must be finite times in s from the first sample on, 0 or more")
        grid, at = np.unique(np.concatenate([[0.0], times]), return_inverse=True)
        derivatives = QUANTITIES.index(wanted) - QUANTITIES.index(self.signal.quantity)
        size = float(np.ptp(self.signal.y)) * features(self.signal).frequency ** derivatives
        plan = make_plan(target.oscillator, target.all_values(mode.z), grid, wanted, PRECISION * size)
        z = laplace_draws(target, mode, BAND, 0)
        every = {**{n: np.full(BAND, float(v)) for n, v in target.known.items()}, **target.values(z)}
        band = plan.many_at_samples(target.oscillator, every)
        value = plan.at_samples(target.oscillator, target.all_values(mode.z))
        here = at[1:]
        unit = UNITS[self.signal.unit].of(wanted)
        return Prediction(times, value[here], band.std(axis=0)[here], wanted, unit)

    def summary(self) -> pd.DataFrame:
        """A row for each inferred parameter: value, sd, unit, prior."""
        import pandas as pd

        priors = {} if self.target is None else self.target.priors
        rows = {
            n: {"value": v, "sd": self.sd[n], "unit": self.units[n], "prior": priors[n].describe()}
            for n, v in self.values.items()
        }
        return pd.DataFrame.from_dict(rows, orient="index", columns=["value", "sd", "unit", "prior"])

    def plot(self, axes: Sequence[Axes] | None = None, until: float | None = None) -> tuple[Axes, Axes]:
        """Draw the record with the fit, and the residuals below; the two axes drawn on.

        until: time in s up to which the fit goes on beyond the record. Raises Refusal without a fit.
        """
        _, _ = self.engine
        above, below = drawing.several(axes, 2, heights=(2, 1))
        t = self.signal.t
        end = float(t[-1]) if until is None else max(float(until), float(t[-1]))
        above.plot(t, self.signal.y, ".", color=drawing.QUIET, ms=2, label="record")
        above.plot(t, self.fitted, color=drawing.BLUE, lw=1.0, label=f"fit of {self.model.damping}")
        if end > t[-1]:
            gap = float(np.median(np.diff(t)))
            ahead = self.predict(np.arange(float(t[-1]), end, gap))
            above.plot(ahead.t, ahead.value, color=drawing.BLUE, lw=1.0, ls="--", label="beyond the record")
            low, high = ahead.value - 2 * ahead.sd, ahead.value + 2 * ahead.sd
            above.fill_between(ahead.t, low, high, color=drawing.BLUE, alpha=0.2, lw=0)
        unit = UNITS[self.signal.unit]
        above.set_ylabel(f"{unit.called(self.signal.quantity)} / {self.signal.y_unit}")
        above.legend(loc="upper right")
        below.plot(t, self.residuals, color=drawing.BLUE, lw=0.6)
        below.axhline(0.0, color=drawing.QUIET, lw=0.6)
        below.set_ylabel(f"residual / {self.signal.y_unit}")
        below.set_xlabel("time / s")
        below.set_xlim(above.get_xlim())
        return above, below

    def _table(self) -> Table:
        rows = [(n, self.units[n], number(v, 6), number(self.sd[n], 2)) for n, v in self.values.items()]
        rows += [(n, "", number(v, 6), "known") for n, v in self.known.items()]
        title = f"Fit of {self.model.name} to {self.signal.name}"
        if self.values:
            rms = float(np.sqrt(np.mean(self.residuals**2)))
            title += f": {self.noise} noise, residual {number(rms, 3)} {self.signal.y_unit} rms"
        return Table(title, ("parameter", "unit", "value", "sd"), tuple(rows), said(self.outcome, self.notes))

    def _packed(self) -> Packed:
        signal, model = self.signal._packed(), self.model._packed()
        meta = {"signal": signal.meta, "model": model.meta, "noise": self.noise, "outcome": self.outcome}
        meta |= {"notes": self.notes, "solved": False}
        arrays = signal.within("signal")
        if self.target is not None and self.mode is not None:
            found, scores = packed_mode(self.mode, self.target, self.target)
            meta |= {"solved": True, "mode": found, "known": dict(self.target.known)}
            meta["priors"] = {n: p.model_dump() for n, p in self.target.priors.items()}
            arrays |= {f"mode/{n}": a for n, a in scores.items()}
        return Packed("Fit", meta, arrays)

    @classmethod
    def _unpacked(cls, packed: Packed) -> Self:
        meta = packed.meta
        signal = Signal._unpacked(packed.part("signal"))
        model = Model._unpacked(packed.part("model"))
        notes = tuple(meta["notes"])
        if not meta["solved"]:
            return cls(signal, model, outcome=meta["outcome"], notes=notes)
        priors = {n: prior_of(p) for n, p in meta["priors"].items()}
        oscillator = Oscillator(model.terms, model.restoring)
        target = Target(signal, oscillator, meta["noise"], priors, meta["known"])
        mode = unpacked_mode(CellResult("", "", meta["mode"], packed.part("mode").arrays), target)
        return cls._solved(signal, model, target, mode, meta["outcome"], notes)

    @classmethod
    def _solved(
        cls, signal: Signal, model: Model, target: Target, mode: Mode, outcome: str, notes: tuple[str, ...]
    ) -> Self:
        values = {n: float(v) for n, v in target.values(mode.z).items()}
        left = residual(target, mode.context.plan, mode.z)
        units = units_of(target.names, model.restoring, signal)
        density = Density(signal, model, values, units, target, mode)
        return cls(
            signal=signal,
            model=model,
            noise=target.noise,
            values=values,
            sd=value_sds(target, mode.z, np.linalg.inv(mode.information)),
            units=units,
            known=dict(target.known),
            fitted=signal.y - left,
            residuals=left,
            log_posterior=density.log_posterior(density.vector()),
            outcome=outcome,
            notes=notes,
            target=target,
            mode=mode,
        )


def fit(
    signal: types.Signal, model: Model, *, start: Mapping[str, float] | None = None, seed: int = 0
) -> Fit:
    """The best fit of a model to a record.

    Searches start from what the record's turning points and a regression say, from two draws of the prior, and from
    start: parameter values by name, such as those of an estimate. With several noise models in play, the one of highest
    evidence is chosen under this model. seed: of the draws. Where the model cannot be fitted to this record the
    result's outcome is a sentence. Raises InputError for misuse, Refusal where model.deviation is not "none".
    """
    own = checked(signal, model)
    refuse_deviation(model)
    keep_programs()
    try:
        case = Case.of(own, model)
        if not case.noisy:
            return Fit(own, model, outcome=NO_POSTERIOR)
        target, mode, notes = _searched(case, start, seed)
    except Refusal as refusal:
        return Fit(own, model, outcome=str(refusal))
    return Fit._solved(own, model, target, mode, OK, notes)


def refuse_deviation(model: Model) -> None:
    """Raises Refusal where a model asks what a single fit does not say yet."""
    if model.deviation != "none":
        raise Refusal(
            f"deviation {model.deviation!r} is not fitted yet: a fit takes the law to hold exactly; "
            'give deviation="none"'
        )


def _searched(
    case: Case, start: Mapping[str, float] | None, seed: int
) -> tuple[Target, Mode, tuple[str, ...]]:
    """The target, its highest mode with the solver's steps set right there, and what was chosen on the way."""
    given = {} if start is None else {"given": dict(start)}
    for name in given.get("given", {}):
        if name not in case.model.parameters:
            raise InputError(
                f"fit: start has unknown parameter {name!r}{nearest(name, list(case.model.parameters))}"
            )
    try:
        starts = given | dict(case.starts())
    except Refusal:
        if not given:
            raise
        starts = dict(given)
    choice = choose(case, starts)
    target = case.target(choice.noise, choice.epsilon)
    seeds = {**choice.starts, **starts, **prior_seeds(target, PRIOR_STARTS, seed)}
    mode = find_mode(target, seeds, noise_level=case.seen.roughness, period=case.seen.period)
    # Made anew at the mode, as it is where a fit is read from a file, so that both are the same.
    again = restore_mode(target, mode.z, mode.log_posterior, mode.information, mode.tolerance, mode.climbs)
    return target, again, choice.notes
