"""Define a model of one decay, and search for its best fit to a record.

A model is a sum of damping terms, a restoring law, noise, priors and known parameters. `Density` is its posterior
density as functions of the parameters, for any sampler or optimiser.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from bayesdamp import types
from bayesdamp.calls import KINDS, checked_call
from bayesdamp.config.checks import check_keys, check_number
from bayesdamp.config.signals import NOISE, canonical_model, check_translation
from bayesdamp.estimators.shared import has_noise
from bayesdamp.formatting import Table, data_frame, digits, nats, percentage
from bayesdamp.inference.deviation.averaged import MOST_CYCLES
from bayesdamp.inference.deviation.candidate import START, MotionCandidate
from bayesdamp.inference.deviation.compare import averaging_of
from bayesdamp.inference.deviation.data import prepare_data
from bayesdamp.inference.deviation.findings import SENSOR
from bayesdamp.inference.deviation.model_comparison import compare_candidates
from bayesdamp.inference.deviation.sample_noise import noises_of, prepare_for_noises
from bayesdamp.inference.deviation.single import Single, fit_single
from bayesdamp.inference.mode import Mode, find_mode, restore_mode
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target, build_target
from bayesdamp.inference.noise import NOISES
from bayesdamp.interface.arguments import EPSILON, check_settings, known_and_priors, names_of_parameters
from bayesdamp.interface.result import Result, ResultView, frame_table
from bayesdamp.interface.signal import Signal
from bayesdamp.physics.oscillator import Oscillator, reference_of
from bayesdamp.physics.restoring import LAWS
from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.priors import Prior, joint_log_density, joint_slope
from bayesdamp.records.oscillation.features import Features, features

if TYPE_CHECKING:
    import pandas as pd


Vector = NDArray[np.float64]
PRECISION = 1e-3
"""Tolerance of the ODE solver in a `Density`, as a fraction of the tolerance of a fit. Measured on viscous, Coulomb,
quadratic and Duffing motions: within three standard deviations of the best fit, the log likelihood then agrees within
1e-3 nats with that of SciPy's solver at a tolerance of 1e-11. With a fit's tolerance the error was up to 0.006 nats, or
up to 0.1 nats if the width ε of Coulomb friction is inferred."""


@dataclass(frozen=True, eq=False, repr=False)
class Density(ResultView):
    """The posterior density of a model on a record.

    Its methods take a vector x of the inferred parameters in the units `units` (not transformed), in the order of
    `names`, and raise InputError if x has another shape. The step sizes of the ODE solver are chosen at the best fit.
    Within three standard deviations of it, the numerical error of the log likelihood is at most 1e-3 nats; farther away
    it is a small fraction of the difference from the maximum. If the model allows deviations from its laws, they are
    integrated out of the likelihood.

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
        """Return the posterior density of a model on a signal, from a posterior mode that was found before.

        The density uses the step sizes of the ODE solver that were chosen at this mode.
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
        """Values that are not inferred, by name: parameters, and constants of the noise model or of damping terms."""
        return self.target.known

    def summary(self) -> pd.DataFrame:
        """Return a table with a row for each parameter, in the order of x: value at the best fit, unit, prior."""
        rows = {n: (self.values[n], self.units[n], p.describe()) for n, p in self.priors.items()}
        return data_frame(rows.values(), ["value", "unit", "prior"], index=rows)

    def vector(self, values: Mapping[str, float] | None = None) -> Vector:
        """Convert values by name to a vector x, (d,). Parameters that are not given have their value in the best fit.

        Raises
        ------
        InputError
            If a name is not an inferred parameter.
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
            what = f"log_posteriors: x has shape {many.shape}"
            raise types.InputError(f"{what}; it must be (m, {len(self.names)})")
        return np.array([self.log_posterior(x) for x in many])

    def gradient(self, x: ArrayLike) -> Vector:
        """Return the gradient of the log posterior (nats) with respect to x, (d,); zeros if the log posterior is −∞."""
        x = self._vector(x)
        value, slopes = self._slopes(x) if np.isfinite(self.log_prior(x)) else (-np.inf, x)
        if not np.isfinite(value):
            return np.zeros_like(x)
        return slopes + joint_slope(list(self.priors.values()), x, self.target.scales)

    def numpyro(self, prefix: str = "") -> Callable[..., dict[str, Any]]:
        """Return this posterior as a NumPyro model function, with parameters in the units `units`.

        Without arguments, the model samples every parameter under its prior. For this it samples nearly uncorrelated
        variables (site `whitened`) and computes the parameters from them; each parameter is a deterministic site with
        its name. A parameter that is passed by name, such as model(zeta=zeta), has that value instead. The caller may
        sample this value, under another prior or in a hierarchy over several records. The model returns all parameters
        by name.

        Parameters
        ----------
        prefix
            Prefix of the names of the model's sites, so that one NumPyro model can contain several records.
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
        """Return the log likelihood in nats at x, (d,), and its gradient with respect to x, (d,)."""
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
            raise types.InputError(f"density: x has shape {vector.shape}; it must be {right}")
        return vector

    def _table(self) -> Table:
        osc = self.target.oscillator
        name = types.candidate_name("+".join(osc.damping), osc.restoring)
        return frame_table(self.summary(), f"Posterior density of {name} on {self.signal.name}")


def units_of(names: Iterable[str], restoring: str, signal: types.Signal) -> dict[str, str]:
    """Return the unit of each parameter, such as "1/s", by its name, in terms of the record's base unit and s.

    It depends on the restoring law, and on the unit and the quantity of the record.
    """
    return {n: parameter_unit(n, restoring, signal.unit, signal.quantity) for n in names}


NOT_INFERRED = (*NOISE, EPSILON)
"""Names of the parameters of the noise, and of the width ε of Coulomb friction. If a model allows deviations from its
laws, they are not inferred: they are known, or estimated once for the record."""
NO_POSTERIOR = (
    "the record has no noise, so there is no posterior; use the unfiltered record, or simulate with noise_sd"
)
"""Message of the `Refusal` that is raised for a record without noise."""
Starts = list[Mapping[str, float]]
"""Starting points of a search: parameter values by name."""


@dataclass(frozen=True, repr=False)
class Model(Result):
    """A model of a record: damping, restoring law, noise, priors and known parameters.

    Parameters
    ----------
    damping
        A sum of damping terms, such as "viscous+coulomb"; the terms are put into a fixed order.
    restoring
        Name of the restoring law, such as "linear" or "pendulum".
    noise
        A noise model ("gaussian", "student_t", "quantised" or "correlated"); or several, or "auto" for all, from which
        one is chosen for the record: the one with the highest evidence. Unless the deviation is "none", Gaussian noise,
        if it is among them, is replaced only by a model whose log evidence is clearly larger (at least 5 nats), and
        never by correlated noise.
    priors
        Priors by damping term or parameter name, in base units (rad, m or the sensor's, and s); other parameters have
        default priors. If a name is both a damping term and a parameter of the restoring law, such as "cubic" with the
        law "duffing", it means the parameter of the law; use "mu_3" for the coefficient of the damping term.
    known
        Values of parameters that are not inferred, by name, in base units. Damping coefficients are always inferred.
        epsilon, the velocity within which Coulomb friction changes its sign, may also be given for a model without
        friction, which ignores it.
    deviation
        "none" (the default): the damping and restoring laws hold exactly. "law" and "auto" have the same effect: they
        may hold approximately, and deviations from them are inferred. The noise variance is then known, or set to the
        residual variance after fitting parameters and deviations.
    sensor
        Relative linearity error of the sensor (sd; 0.002 by default), which is added in quadrature to the error of
        every damping ratio. It is not used with the deviation "none".
    amplitude, frequency
        Amplitude and frequency to which default priors are scaled, in the base unit of the displacement (rad, m or the
        sensor's) and in rad/s. By default they follow from the known parameters if these suffice, or else from the
        record, rounded to two digits.

    Raises
    ------
    InputError
        If an argument is invalid. For an unknown name, the message gives the nearest valid one.

    Examples
    --------
    >>> import bayesdamp as bd
    >>> model = bd.Model("viscous+coulomb", restoring="pendulum", priors={"viscous": bd.HalfNormal(0.1)})
    >>> model.name, model.terms
    ('viscous+coulomb@pendulum', ('viscous', 'coulomb'))
    """

    damping: str
    restoring: str = "linear"
    noise: str | tuple[str, ...] = "auto"
    priors: Mapping[str, Prior] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    deviation: str = "none"
    sensor: float = SENSOR
    amplitude: float | None = None
    frequency: float | None = None

    def __post_init__(self) -> None:
        LAWS.get(self.restoring, "Model")
        object.__setattr__(self, "damping", canonical_model(self.damping, "Model.damping"))
        object.__setattr__(self, "noise", check_settings("Model", self.noise, self.deviation, self.sensor))
        known, priors = known_and_priors("Model", self.known, self.priors, self.terms, self.parameters)
        object.__setattr__(self, "known", {n: v for n, v in known.items() if n in self.parameters})
        object.__setattr__(self, "priors", dict(self.priors))
        fixed = [n for n in priors if n in NOT_INFERRED] if self.approximate else []
        if fixed:
            raise types.InputError(
                f"Model: {fixed[0]!r} is not inferred under deviation {self.deviation!r}; remove its prior, or give "
                "its value as known"
            )
        for name in ("amplitude", "frequency"):
            if (value := getattr(self, name)) is not None:
                check_number(value, f"Model.{name}", positive=True)

    def __hash__(self) -> int:
        return hash((self.damping, self.restoring, self.noise, self.deviation, self.sensor))

    @property
    def name(self) -> str:
        """Name of the model, always its damping and its restoring law, such as `viscous+coulomb@pendulum`."""
        return types.candidate_name(self.damping, self.restoring)

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the damping terms."""
        return tuple(self.damping.split("+"))

    @property
    def noises(self) -> tuple[str, ...]:
        """Names of the noise models from which one is chosen; all for "auto"."""
        return noises_of(self.noise)

    @property
    def approximate(self) -> bool:
        """Whether the damping and restoring laws may hold approximately; deviations from them are then inferred."""
        return self.deviation != "none"

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters, including known ones and those of every noise model that may be chosen."""
        noise = dict.fromkeys(p for n in self.noises for p in NOISES.get(n).parameters)
        return (*Oscillator(self.terms, self.restoring).parameters, *noise)

    @property
    def system(self) -> types.System:
        """Known values, and in `free` the priors of other parameters (None: default), in the form that fits use."""
        given, unknown = self.parameter_priors, [n for n in self.parameters if n not in self.known]
        free = {n: given.get(n) for n in unknown if n != "epsilon" or n in given}
        return types.System(self.restoring, dict(self.known), free, self.amplitude, self.frequency)

    @property
    def parameter_priors(self) -> dict[str, Prior]:
        """The specified priors, by name of the parameter (such as "zeta", not "viscous")."""
        names = names_of_parameters(self.terms, self.parameters)
        return {names[name]: prior for name, prior in self.priors.items()}

    def bind(self, signal: types.Signal) -> Density:
        """Fit the model to a record, and return its posterior density as functions of the parameters.

        The step sizes of the ODE solver are chosen at the best fit. If the model allows deviations from its laws, they
        are integrated out.

        Parameters
        ----------
        signal
            The record.

        Raises
        ------
        InputError
            If the restoring law does not suit the unit of the record, or an oscillator with the known parameters cannot
            oscillate about the record's midline.
        Refusal
            If the model cannot be fitted to this record.
        """
        own = check_signal(signal, self)
        mode = fit_approximate(own, self).mode if self.approximate else fit_exact(own, self, None)[0]
        return Density.at(own, self, mode)

    def summary(self) -> pd.DataFrame:
        """Return a table with a row for each parameter: its known value, and its specified prior, if given.

        Default priors depend on the record; they are in the summary of a fit.
        """
        given = {n: p.describe() for n, p in self.parameter_priors.items()}
        rows = [(n, self.known.get(n), given.get(n)) for n in self.parameters]
        return data_frame(rows, ["parameter", "known", "prior"]).set_index("parameter")

    def _table(self) -> Table:
        noise = self.noise if isinstance(self.noise, str) else " or ".join(self.noise)
        laws = f", deviation {self.deviation}, sensor {digits(self.sensor, n=3)}" if self.approximate else ""
        return frame_table(self.summary().fillna(""), f"Model {self.name}, {noise} noise{laws}")


Model.__init__ = checked_call(Model.__init__, "Model")
KINDS["model"] = ((Model,), "a Model")


@dataclass(frozen=True)
class Case:
    """A record and a model, with the features of the record to which default priors are scaled.

    Its methods `target` and `mode` assume exact laws of damping and restoring force.

    Attributes
    ----------
    signal
        The record.
    model
        The model.
    features
        Period, noise level and other features of the record.
    reference
        Amplitude (rad, m or the sensor's unit) and angular frequency (rad/s) to which default priors are scaled.
    """

    signal: types.Signal
    model: Model
    features: Features
    reference: types.Reference

    @classmethod
    def of(cls, signal: types.Signal, model: Model) -> Case:
        """Create the case of a record and a model, and compute the record's features.

        Raises Refusal if the record shows no oscillation, and InputError if an oscillator with the known parameters
        cannot oscillate about the record's midline.
        """
        own = features(signal)
        return cls(signal, model, own, reference_of(model.system, own))

    @classmethod
    def with_noise(cls, signal: types.Signal, model: Model) -> Case:
        """Create the case of a record and a model as `of` does, but also raise Refusal if the record has no noise."""
        case = cls.of(signal, model)
        if not has_noise(signal, case.features):
            raise types.Refusal(NO_POSTERIOR)
        return case

    @property
    def problem(self) -> types.Problem:
        """The damping terms, the restoring law, known values and priors, in the form that estimators use."""
        return types.Problem(self.model.terms, self.model.system)

    def target(self, noise: str, epsilon: float | None = None) -> Target:
        """Return the posterior that searches and samplers use, with one noise model.

        Parameters
        ----------
        noise
            The noise model.
        epsilon
            Velocity in rad/s (m/s for a translation) within which Coulomb friction changes its sign, if it was chosen
            for this record. With None it is as the model states it: known, inferred, or else the default
            (`Reference.friction_width`).

        Raises
        ------
        Refusal
            If the record is not suited to this noise model.
        """
        system = self.model.system
        if epsilon is not None:
            system = replace(system, known={**system.known, "epsilon": epsilon})
        return build_target(self.signal, self.model.terms, system, self.features, self.reference, noise=noise)

    def mode(
        self, noises: Sequence[str], epsilon: float | None, starts: Starts
    ) -> tuple[Mode, tuple[str, ...]]:
        """Choose the noise model and the width ε of friction, and search for the highest posterior mode.

        ε is the velocity within which Coulomb friction changes its sign. Both choices are based on a least-squares fit,
        which is also the first starting point of the search. If this fit fails, the search begins at `starts` alone,
        with the first noise model and the default ε.

        Parameters
        ----------
        noises
            Names of the noise models; the one with the highest evidence is chosen. If the user gave a value or a prior
            of a noise parameter, models without this parameter are left out.
        epsilon
            ε in rad/s (m/s for a translation), if it was chosen before for this record; else None. It is chosen here if
            it is neither known nor inferred.
        starts
            Further starting points: parameter values by name.

        Returns
        -------
        mode
            The highest mode.
        notes
            Sentences on the choices.

        Raises
        ------
        Refusal
            If the least-squares fit fails and there are no further starting points, if no starting point leads to a
            mode, or if the record is not suited to the noise models.
        """
        model, known = self.model, self.model.system.known
        own = {n: set(NOISES.get(n).parameters) for n in noises}
        given = set.union(*own.values()) & {*model.known, *model.priors}
        noises, level = tuple(n for n in noises if given <= own[n]), self.features.roughness
        try:
            with threadpool_limits(1, "blas"):
                comparison = compare_candidates(
                    prepare_data(self.signal, average=False),
                    [MotionCandidate(model.terms, model.restoring)],
                    known=known if epsilon is None else {**known, "epsilon": epsilon},
                    priors=model.parameter_priors,
                    reference=self.reference,
                    approximate=False,
                    noises=noises,
                )
        except types.Refusal as refusal:
            if not starts or not noises:
                raise
            note = f"The search began only at the given start, with {noises[0]} noise, because {refusal}."
            return find_mode(self.target(noises[0], epsilon), starts, noise_level=level), (note,)
        notes, fit = [], comparison.best.fit
        if comparison.frictions and "epsilon" not in model.priors:
            epsilon = comparison.epsilon
            width, share = digits(epsilon, n=3), percentage(types.FRICTION_WIDTH)
            notes.append(
                f"The width ε of friction was not given, so {width} {self.signal.unit}/s is used. The default is "
                f"{share} % of the peak velocity; another width is used only if it is clearly more probable."
            )
        order = sorted(comparison.noise.weighed, key=lambda noise: -noise.log_evidence)
        if len(order) > 1:
            ahead = nats(order[0].log_evidence - order[1].log_evidence)
            notes.append(f"Noise: {order[0].name}, {ahead} nats ahead of {order[1].name} in log evidence.")
        target = self.target(comparison.noise.likeliest, epsilon)
        starts = [fit.parameters.named(fit.z), *starts]
        return find_mode(target, starts, noise_level=level), tuple(notes)


def check_signal(signal: types.Signal, model: Model) -> Signal:
    """Check whether a model suits a signal, and return the signal as a `Signal` of the interface.

    Raises InputError if the restoring law describes an angle but the record is a translation.
    """
    check_translation(signal.unit, model.restoring, signal.name)
    return Signal.of(signal)


def fit_approximate(signal: Signal, model: Model) -> Single:
    """Fit a model that allows deviations of damping and restoring force from their laws; return its linearised fit.

    A record of many cycles is first reduced to amplitudes and phases, averaged over cycles. If this is not accurate
    enough, a record of at most `MOST_CYCLES` cycles is fitted again without averages. A record with a known initial
    displacement or velocity is not reduced. Raises Refusal if the model cannot be fitted to the record, and InputError
    as `Case.of`.
    """
    fit = partial(
        fit_single,
        damping=model.terms,
        restoring=model.restoring,
        known=model.known,
        priors=model.parameter_priors,
        reference=Case.with_noise(signal, model).reference,
        noises=model.noises,
    )
    average = not any(n in model.known for n in START)
    result = fit(prepare_for_noises(signal, model.noises, model.known, model.parameter_priors, average))
    averaging = averaging_of(result.comparison)
    if averaging is not None and not averaging.close and averaging.cycles <= MOST_CYCLES:
        return fit(prepare_data(signal, average=False))
    return result


def fit_exact(
    signal: Signal, model: Model, start: Mapping[str, float] | None
) -> tuple[Mode, tuple[str, ...]]:
    """Fit a model that assumes exact laws of damping and restoring force.

    Parameters
    ----------
    signal, model
        The record and the model.
    start
        A further starting point: parameter values by name, in base units (rad, m or the sensor's, and s); or None.

    Returns
    -------
    mode
        The highest posterior mode, under the noise model that was chosen.
    notes
        Sentences on the choice of the noise model, and of the width ε of the velocity range in which Coulomb friction
        changes its sign.

    Raises
    ------
    InputError
        If `start` has an unknown parameter, or an oscillator with the known parameters cannot oscillate about the
        record's midline.
    Refusal
        If the model cannot be fitted to the record.
    """
    check_keys(start or (), model.parameters, "fit.start")
    start = start and {name: check_number(value, f"fit.start.{name}") for name, value in start.items()}
    case = Case.with_noise(signal, model)
    mode, notes = case.mode(model.noises, None, [] if start is None else [start])
    # Restore the mode as when a fit is read from a file, so that both give exactly the same numbers.
    return restore_mode(mode.likelihood.target, mode.stored), notes
