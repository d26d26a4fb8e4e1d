"""A point estimate by one of the estimators, at both of its stages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from bayesdamp import types
from bayesdamp.estimators import STAGES
from bayesdamp.estimators import run as run_estimator
from bayesdamp.estimators.shared import start_parameters
from bayesdamp.formatting import compact
from bayesdamp.interface.fitting.case import Case
from bayesdamp.interface.fitting.search import checked
from bayesdamp.interface.model import Model
from bayesdamp.interface.parts import axes as drawing
from bayesdamp.interface.parts.definitions import units_of
from bayesdamp.interface.parts.result import Result
from bayesdamp.interface.records.signal import Signal
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import simulate
from bayesdamp.table import Table
from bayesdamp.types import OK, Refusal

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Result):
    """What one estimator says of a record.

    initial: its own computation from the record; refined: the least-squares trajectory that starts there. Each has
    values and stderr by parameter (SI units, only what was computed), trace, details, evaluations, seconds, outcome.
    """

    signal: Signal
    model: Model
    estimator: str
    initial: types.Estimate
    refined: types.Estimate
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def outcome(self) -> str:
        """ "ok", or what the stages say, in a sentence each."""
        said = [f"{s.stage}: {s.outcome}" for s in (self.initial, self.refined) if s.outcome != OK]
        return "; ".join(said) or OK

    @property
    def values(self) -> Mapping[str, float]:
        """Of the last stage that has some; a start for `fit`."""
        return self.refined.values or self.initial.values

    def summary(self) -> pd.DataFrame:
        """A row for each parameter: value and standard error at both stages, unit."""
        import pandas as pd

        columns = [f"{what}_{stage}" for stage in STAGES for what in ("value", "stderr")]
        rows: dict[str, dict[str, object]] = {}
        for name in {**self.initial.values, **self.refined.values}:
            rows[name] = {}
            for stage in (self.initial, self.refined):
                rows[name][f"value_{stage.stage}"] = stage.values.get(name, np.nan)
                rows[name][f"stderr_{stage.stage}"] = stage.stderr.get(name, np.nan)
            rows[name]["unit"] = self.units[name]
        return pd.DataFrame.from_dict(rows, orient="index", columns=[*columns, "unit"])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the record with the motion of each stage that has values; the axes drawn on. What a stage does not
        compute itself is as known, or read off the record. Raises Refusal where neither stage has values."""
        if not self.values:
            raise Refusal(self.outcome)
        ax = drawing.one(ax)
        t, unit = self.signal.t, self.signal.own_unit
        ax.plot(t, unit.scale * self.signal.y, ".", color=drawing.QUIET, ms=2, label="record")
        case = Case.of(self.signal, self.model)
        rest = start_parameters(self.signal, case.problem, case.seen)
        oscillator = Oscillator(self.model.terms, self.model.restoring)
        looks = ((self.initial, ":", drawing.INK), (self.refined, "-", drawing.BLUE))
        for stage, dashes, colour in looks:
            every = {**rest, **stage.values}
            if stage.values and all(n in every for n in oscillator.parameters):
                motion = simulate(
                    oscillator, every, t, self.signal.quantity, 1e-4 * float(np.ptp(self.signal.y))
                )
                ax.plot(t, unit.scale * motion, dashes, color=colour, lw=1.0, label=stage.stage)
        ax.set_xlabel("time / s")
        ax.set_ylabel(f"{unit.called(self.signal.quantity)} / {unit.of(self.signal.quantity)}")
        ax.set_title(f"{self.estimator}, {self.model.name}", fontsize="small", loc="left")
        ax.legend(loc="upper right")
        return ax

    def _table(self) -> Table:
        rows: list[tuple[str, ...]] = []
        for name in {**self.initial.values, **self.refined.values}:
            cells = [
                (s.values.get(name, np.nan), s.stderr.get(name, np.nan)) for s in (self.initial, self.refined)
            ]
            rows.append(
                (name, self.units[name], *(c for v, e in cells for c in (compact(v, 6), compact(e, 2))))
            )
        columns = ("parameter", "unit", "initial", "stderr", "refined", "stderr")
        notes = tuple(f"{s.stage}: {s.outcome}" for s in (self.initial, self.refined) if s.outcome != OK)
        title = f"Estimate of {self.model.name} on {self.signal.name} by {self.estimator}"
        return Table(columns, rows, caption=title, notes=notes)


def estimate(
    signal: types.Signal,
    estimator: str,
    model: Model,
    *,
    options: Mapping[str, object] | None = None,
    seed: int = 0,
) -> Estimate:
    """One estimator on a record, both stages.

    estimator: a name in `bayesdamp.estimators.ESTIMATORS`, the eleven among them. options: its own, by name. Where the
    method cannot work on the record the outcome of its stage is the sentence. Raises InputError for misuse.

    >>> import bayesdamp as bd
    >>> signal = bd.simulate({"viscous": 0.05}, stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
    >>> model = bd.Model("viscous", noise="gaussian", known={"rest_angle": 0.0})
    >>> found = bd.estimate(signal, "envelope", model)
    >>> [round(stage.values["zeta"], 2) for stage in (found.initial, found.refined)]
    [0.05, 0.05]
    """
    own = checked(signal, model)
    units: dict[str, str] = {}
    try:
        case = Case.of(own, model)
        initial, refined = run_estimator(estimator, own, case.problem, options=options, seed=seed)
        units = units_of({**initial.values, **refined.values}, model.restoring, own)
    except Refusal as refusal:
        initial, refined = (types.Estimate(estimator, stage, outcome=str(refusal)) for stage in STAGES)
    return Estimate(own, model, estimator, initial, refined, units)
