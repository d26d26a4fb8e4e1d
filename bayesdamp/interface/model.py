"""Define a model of one decay, and search for its best fit to a record."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

from threadpoolctl import threadpool_limits

from bayesdamp import types
from bayesdamp.calls import told
from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.data import prepared
from bayesdamp.inference.deviation.quick import averaging_of
from bayesdamp.inference.deviation.sample_noise import MOST_CYCLES, noises_of, prepared_for
from bayesdamp.inference.deviation.single import Single, single
from bayesdamp.inference.deviation.weighing import START, weigh_all
from bayesdamp.inference.fit.mode import Mode, restore_mode
from bayesdamp.inference.noise import NOISES
from bayesdamp.interface.case import Case, Starts
from bayesdamp.interface.density import Density
from bayesdamp.interface.signal import Signal
from bayesdamp.interface.specification import Specification
from bayesdamp.physics.restoring import LAWS
from bayesdamp.plugins import nearest
from bayesdamp.types import InputError, Refusal, Seed
from bayesdamp.units import UNITS


class Model(Specification):
    """A model of a record: damping, restoring law, noise, priors and known parameters.

    Parameters
    ----------
    damping
        A sum of damping terms, such as "viscous+coulomb".
    restoring
        The restoring law.
    noise
        A noise model; or several, or "auto" for all, of which the evidence chooses one for the record.
    priors
        Priors by damping term or parameter name; parameters without one have the default.
    known
        Values of parameters that are not inferred, by name. Damping coefficients are always inferred. Friction's
        epsilon may be given for a model without friction, which ignores it.
    deviation
        "none": laws hold exactly; "law" or "auto": they may hold approximately, with deviations that are inferred. The
        size of the noise is then known, or determined from what neither parameters nor deviations explain.
    sensor
        Relative linearity of the sensor, the least error of a damping ratio; used where laws may hold approximately.
    amplitude, frequency
        Reference that default priors scale with, in the unit of the displacement and in rad/s; by default the system's
        where it is known, otherwise the record's, to two digits.

    Raises
    ------
    InputError
        Where an argument makes no sense; with the nearest valid name.

    Examples
    --------
    >>> import bayesdamp as bd
    >>> model = bd.Model("viscous+coulomb", restoring="pendulum", priors={"viscous": bd.HalfNormal(0.1)})
    >>> model.name, model.terms
    ('viscous+coulomb@pendulum', ('viscous', 'coulomb'))
    """

    if not TYPE_CHECKING:
        __init__ = told(Specification.__init__, "Model")

    def bind(self, signal: types.Signal, *, seed: int = 0) -> Density:
        """Return the posterior density on a record, as plain functions of the parameters in natural units.

        The model is fitted first, and the solver's steps are set at the best fit. Where laws may hold approximately,
        deviations are integrated out.

        Parameters
        ----------
        signal
            The record.
        seed
            Seed of the search.

        Raises
        ------
        Refusal
            Where the model cannot be fitted to this record.
        """
        own = check_signal(signal, self)
        mode = fit_approximate(own, self).mode if self.approximate else fit_exact(own, self, None, seed)[0]
        return Density.at(own, self, mode)


def check_signal(signal: object, model: object) -> Signal:
    """Return the signal as a `Signal` of the interface.

    Raises
    ------
    InputError
        Where an argument has another type, or the restoring law does not suit the record.
    """
    if not isinstance(signal, types.Signal):
        raise InputError(
            f"signal is {type(signal).__name__}; it must be a Signal, such as read(...).signal() gives"
        )
    if not isinstance(model, Model):
        raise InputError(f"model is {type(model).__name__}; it must be a Model")
    if UNITS[signal.unit].translates and not LAWS.get(model.restoring).translates:
        laws = ", ".join(n for n in LAWS.names() if LAWS.get(n).translates)
        raise InputError(
            f"{signal.name}: is in {signal.unit}, a translation, which {model.restoring} does not describe; "
            f"restoring can be {laws}"
        )
    return Signal.of(signal)


def fit_approximate(signal: Signal, model: Model) -> Single:
    """Fit a model with laws that may hold approximately. Raises Refusal where that cannot be done."""
    case = Case.with_noise(signal, model)
    noises = noises_of(model.noise)
    fit = partial(
        single,
        damping=model.terms,
        restoring=model.restoring,
        known=model.known,
        priors=model.parameter_priors,
        reference=case.reference,
        noises=noises,
    )
    average = not any(n in model.known for n in START)
    result = fit(prepared_for(signal, noises, model.known, model.parameter_priors, average))
    averaging = averaging_of(result.weighing)
    if averaging is not None and not averaging.close and averaging.cycles <= MOST_CYCLES:
        return fit(prepared(signal, average=False))
    return result


def fit_exact(
    signal: Signal, model: Model, start: Mapping[str, float] | None, seed: int
) -> tuple[Mode, tuple[str, ...]]:
    """Fit a model with laws that hold exactly.

    Returns
    -------
    mode
        The highest mode under the noise that was chosen, where the solver's steps are set.
    notes
        Sentences on what was chosen.

    Raises
    ------
    InputError
        Where `start` has an unknown parameter.
    Refusal
        Where the model cannot be fitted to the record.
    """
    case = Case.with_noise(signal, model)
    given = {} if start is None else {Seed("given"): dict(start)}
    for name in start or ():
        if name not in model.parameters:
            raise InputError(
                f"fit: start has unknown parameter {name!r}{nearest(name, list(model.parameters))}"
            )
    try:
        starts = given | dict(case.starts())
    except Refusal:
        if not given:
            raise
        starts = dict(given)
    noise, epsilon, notes, chosen = _choose(case, model)
    mode = case.mode(noise, epsilon, {**chosen, **starts}, seed=seed)
    # Restored at the mode, as it is where a fit is read from a file, so that both are the same.
    return restore_mode(mode.likelihood.target, mode.stored), notes


def _choose(case: Case, model: Model) -> tuple[str, float | None, tuple[str, ...], Starts]:
    """Choose the noise model by its evidence under the model's own damping, where several are possible.

    Then choose the width of friction, where it is neither known nor inferred.

    Returns
    -------
    noise
        The noise model.
    epsilon
        Width of friction in rad/s, where one was chosen.
    notes
        Sentences on both.
    starts
        Where the fit that chose them ended.

    Raises
    ------
    Refusal
        Where the model cannot be fitted to the record.
    """
    names = model.noises
    if len(names) == 1:
        return names[0], None, (), {}
    own = {n: set(NOISES.get(n).parameters) for n in names}
    given = set.union(*own.values()) & {*model.known, *model.priors}
    candidate = MotionCandidate(model.terms, model.restoring)
    with threadpool_limits(1, "blas"):
        weighing = weigh_all(
            prepared(case.signal, average=False),
            [candidate],
            known=model.system.known,
            priors=model.parameter_priors,
            reference=case.reference,
            approximate=False,
            noises=tuple(n for n in names if given <= own[n]),
        )
    if not weighing.results:
        raise Refusal(weighing.refused[candidate])
    fit = weighing.results[0].fit
    epsilon, notes = None, []
    if weighing.frictions and "epsilon" not in model.priors:
        epsilon = weighing.epsilon
        notes.append(f"ε was not given; {epsilon:.3g} {case.signal.unit}/s suits the record best.")
    order = sorted(weighing.noise.weighed, key=lambda noise: -noise.log_evidence)
    if len(order) > 1:
        ahead = order[0].log_evidence - order[1].log_evidence
        notes.append(f"Noise: {order[0].name}, {ahead:.3g} nats ahead of {order[1].name}.")
    starts = {Seed("fit that chose the noise"): fit.parameters.named(fit.z)}
    return weighing.noise.likeliest, epsilon, tuple(notes), starts
