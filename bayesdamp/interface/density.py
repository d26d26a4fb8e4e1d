"""Provide a posterior density as functions of the parameters, for any sampler or optimiser."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayesdamp import types
from bayesdamp.config.checks import check_keys
from bayesdamp.formatting import Table, data_frame
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.interface.result import Result, ResultView, frame_table
from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.priors import Prior, joint_log_density, joint_slope
from bayesdamp.types import InputError, candidate_name

if TYPE_CHECKING:
    import pandas as pd

Vector = NDArray[np.float64]
PRECISION = 1e-3
"""Tolerance of the solver, as a fraction of the fit's tolerance. Measured on viscous, Coulomb, quadratic and Duffing
motions: within three standard deviations of the best fit, the log likelihood then agrees within 1e-3 nats with that of
SciPy's solver at a tolerance of 1e-11. With the fit's own tolerance the error was up to 0.006 nats, or up to 0.1 if the
width of friction is inferred."""


@dataclass(frozen=True, eq=False, repr=False)
class Density(ResultView):
    """The posterior density of a model on a record.

    Its methods take a vector x of the parameters in natural units, in the order of `names`. The solver's step sizes are
    chosen at the best fit. Within three standard deviations of it the error of the log likelihood is at most 1e-3 nats;
    farther away it is a small fraction of the difference from the maximum.

    Attributes
    ----------
    signal, model
        The record and the model.
    values, units
        Values of the parameters at the best fit, and their units, by name.
    target, mode
        The posterior and its mode in the form that the package's samplers use.

    Examples
    --------
    >>> import bayesdamp as bd
    >>> signal = bd.simulate({"viscous": 0.05}, stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
    >>> density = bd.Model("viscous", noise="gaussian", known={"rest_angle": 0.0}).bind(signal)
    >>> density.names
    ('zeta', 'stiffness', 'theta0', 'omega0', 'noise_sd')
    >>> best = density.vector()
    >>> density.log_posterior(best) > density.log_posterior(density.vector({"zeta": 0.1}))
    True
    """

    signal: types.Signal
    model: Result
    values: Mapping[str, float]
    units: Mapping[str, str]
    target: Target = field(repr=False)
    mode: Mode = field(repr=False)

    @classmethod
    def at(cls, signal: types.Signal, model: Result, mode: Mode) -> Self:
        """Return the posterior density of a model on a signal whose posterior mode was found before.

        The density uses the step sizes of the solver that were chosen at this mode.
        """
        target = mode.likelihood.target
        values = {n: float(v) for n, v in target.values(mode.z).items()}
        units = units_of(target.names, target.oscillator.restoring, signal)
        return cls(signal, model, values, units, target, mode)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the inferred parameters, in the order of x."""
        return self.target.names

    @property
    def priors(self) -> Mapping[str, Prior]:
        """The prior of each inferred parameter by name, including default priors."""
        return self.target.priors

    @property
    def known(self) -> Mapping[str, float]:
        """Values of parameters that are not inferred, by name."""
        return self.target.known

    def summary(self) -> pd.DataFrame:
        """Return a table with a row for each parameter, in the order of x: value at the best fit, unit, prior."""
        rows = {n: (self.values[n], self.units[n], p.describe()) for n, p in self.priors.items()}
        return data_frame(rows.values(), ["value", "unit", "prior"], index=rows)

    def vector(self, values: Mapping[str, float] | None = None) -> Vector:
        """Convert values by name to a vector x, (d,). Parameters without a value have that of the best fit.

        Raises
        ------
        InputError
            If a name is not a parameter.
        """
        check_keys(values or {}, self.names, "vector")
        return np.array([float({**self.values, **(values or {})}[n]) for n in self.names])

    def log_prior(self, x: ArrayLike) -> float:
        """Return the normalised log density of the prior at x, (d,); −∞ outside its support."""
        return float(joint_log_density(list(self.priors.values()), self._vector(x), self.target.scales))

    def log_likelihood(self, x: ArrayLike) -> float:
        """Return the log density of the record in nats at x, (d,).

        It is −∞ if the motion grows without bound, and outside the support of the prior.
        """
        x = self._vector(x)
        if not np.isfinite(self.log_prior(x)):
            return -np.inf
        return self._likelihood.log_likelihood_of(self._parameters(x))

    def log_posterior(self, x: ArrayLike) -> float:
        """Return log prior plus log likelihood at x, (d,), not normalised; −∞ outside the support of the prior."""
        return self.log_prior(x) + self.log_likelihood(x)

    def log_posteriors(self, x: ArrayLike) -> Vector:
        """Return `log_posterior` at each of m vectors x, (m, d), as an array (m,)."""
        many = np.array(x, float)
        if many.ndim != 2 or many.shape[1] != len(self.names):
            raise InputError(f"density: x has shape {many.shape}; it must be (m, {len(self.names)})")
        return np.array([self.log_posterior(x) for x in many])

    def gradient(self, x: ArrayLike) -> Vector:
        """Return the gradient of the log posterior in natural units at x, (d,); zeros if the log posterior is −∞."""
        x = self._vector(x)
        value, slopes = self._slopes(x) if np.isfinite(self.log_prior(x)) else (-np.inf, x)
        if not np.isfinite(value):
            return np.zeros_like(x)
        return slopes + joint_slope(list(self.priors.values()), x, self.target.scales)

    def numpyro(self, prefix: str = "") -> Callable[..., dict[str, Any]]:
        """Return a NumPyro model function of this posterior, with parameters in natural units.

        Without arguments, the model samples every parameter under its prior. It samples whitened standard normal
        scores (site `whitened`), and each parameter is a deterministic site with its name. A parameter that is passed
        by name, such as model(zeta=zeta), has that value instead. The caller may sample this value, under another prior
        or in a hierarchy over several records. The model returns all parameters by name.

        Parameters
        ----------
        prefix
            Prefix of the names of its sites, so that one model can contain several records.
        """
        from bayesdamp.interface.numpyro_model import numpyro_model

        covariance = self.mode.factor @ self.mode.factor.T
        return numpyro_model(self.priors, self._slopes, self.mode.z, covariance, prefix)

    @cached_property
    def _likelihood(self) -> Likelihood:
        """The log likelihood, with a finer tolerance of the solver than fits and samplers use."""
        likelihood = self.mode.likelihood
        return replace(likelihood, tolerance=PRECISION * likelihood.tolerance)

    def _slopes(self, x: Vector) -> tuple[float, Vector]:
        """Return the log likelihood at x, (d,), and its gradient in natural units, (d,)."""
        return self._likelihood.slopes_of(self._parameters(x))

    def _parameters(self, x: Vector) -> dict[str, float]:
        """Return the values of all parameters at x, (d,), by name, including the known ones."""
        return {**self.target.known, **dict(zip(self.names, x.tolist(), strict=True))}

    def _vector(self, x: ArrayLike) -> Vector:
        """Convert x to an array, (d,). Raises InputError if it has another shape."""
        try:
            vector = np.array(x, float)
        except (TypeError, ValueError):
            vector = np.empty(0)
        if vector.shape != (len(self.names),):
            right = f"{len(self.names)} numbers: {', '.join(self.names)}"
            raise InputError(f"density: x has shape {vector.shape}; it must be {right}")
        return vector

    def _table(self) -> Table:
        name = candidate_name("+".join(self.target.oscillator.damping), self.target.oscillator.restoring)
        return frame_table(self.summary(), f"Posterior density of {name} on {self.signal.name}")


def units_of(names: Iterable[str], restoring: str, signal: types.Signal) -> dict[str, str]:
    """Return the base unit of each parameter, such as "1/s", for a record and a restoring law, by its name."""
    return {n: parameter_unit(n, restoring, signal.unit, signal.quantity) for n in names}
