"""Run one damping estimator on a record, and refine its estimate by a least-squares fit of the trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from bayesdamp import types
from bayesdamp.estimators import STAGES, run as run_estimator
from bayesdamp.formatting import Table, data_frame
from bayesdamp.interface.model import Case, Model, check_signal, units_of
from bayesdamp.interface.result import Result, frame_table
from bayesdamp.interface.signal import Signal

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Result):
    """The result of one estimator on a record.

    Attributes
    ----------
    signal, model, estimator
        The record, the model, and the name of the estimator.
    initial, refined
        The estimator's own estimate from the record, and the result of the least-squares trajectory fit that starts
        from it. Each has the fields values and stderr (standard errors), by parameter, in the units `units`; details;
        evaluations (number of simulations, fits or models that were evaluated); seconds (computing time); and outcome.
        values and stderr contain only the parameters that were computed.
    units
        Unit of each parameter that one of the two stages computed, by name.
    """

    signal: Signal
    model: Model
    estimator: str
    initial: types.Estimate
    refined: types.Estimate
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def outcome(self) -> str:
        """ "ok", or the name of each stage that failed or is doubtful, with the reason."""
        return "; ".join(self._failures) or types.OK

    @property
    def _failures(self) -> tuple[str, ...]:
        """A sentence for each stage whose outcome is not "ok", with its name and its outcome."""
        return tuple(f"{s.stage}: {s.outcome}" for s in (self.initial, self.refined) if s.outcome != types.OK)

    @property
    def values(self) -> Mapping[str, float]:
        """Values of the trajectory fit, or else of the estimator itself, by parameter; empty if neither has any.

        These values can be a starting point for `fit`.
        """
        return self.refined.values or self.initial.values

    def summary(self) -> pd.DataFrame:
        """Return a table with a row for each parameter: value and standard error at both stages, and unit.

        The columns are value_initial, stderr_initial, value_refined, stderr_refined and unit; NaN if not computed.
        """
        columns = {
            f"{what}_{stage.stage}": [values.get(name, np.nan) for name in self.units]
            for stage in (self.initial, self.refined)
            for what, values in (("value", stage.values), ("stderr", stage.stderr))
        }
        return data_frame({**columns, "unit": list(self.units.values())}, index=self.units)

    def _table(self) -> Table:
        title = f"Estimate of {self.model.name} on {self.signal.name} by {self.estimator}"
        return frame_table(self.summary(), title, self._failures)


def estimate(
    signal: types.Signal,
    estimator: str,
    model: Model,
    *,
    options: Mapping[str, object] | None = None,
    seed: int = 0,
) -> Estimate:
    """Run one damping estimator on a record, and a least-squares trajectory fit that starts from its estimate.

    Parameters
    ----------
    signal
        The record.
    estimator
        A name in `bayesdamp.estimators.ESTIMATORS`, such as "envelope" or "sindy": one of the eleven of the package, or
        one of your own.
    model
        The model. Its noise models, priors, deviation and sensor have no effect, because estimators do not use them and
        the trajectory fit minimises the sum of squares. Use `fit` for a fit with priors.
    options
        Options of the estimator, by name, as in a study; by default its own defaults.
    seed
        Seed of all random numbers.

    Returns
    -------
    Estimate
        The estimates of both stages. If a stage fails, its outcome is a sentence with the reason.

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
    >>> estimate = bd.estimate(signal, "envelope", model)
    >>> [round(stage.values["zeta"], 2) for stage in (estimate.initial, estimate.refined)]
    [0.05, 0.05]
    """
    own = check_signal(signal, model)
    units: dict[str, str] = {}
    try:
        case = Case.of(own, model)
        initial, refined = run_estimator(estimator, own, case.problem, options=options, seed=seed)
        units = units_of({**initial.values, **refined.values}, model.restoring, own)
    except types.Refusal as refusal:
        initial, refined = (types.Estimate(estimator, stage, outcome=str(refusal)) for stage in STAGES)
    return Estimate(own, model, estimator, initial, refined, units)
