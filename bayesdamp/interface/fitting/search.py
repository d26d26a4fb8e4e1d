"""A model on a record: what is chosen for the record, and the search for the best fit."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from threadpoolctl import threadpool_limits

from bayesdamp import types
from bayesdamp.inference.deviation.candidate import Candidate
from bayesdamp.inference.deviation.data import prepared
from bayesdamp.inference.deviation.quick import averaging_of
from bayesdamp.inference.deviation.sample_noise import MOST_CYCLES, noises_of, prepared_for
from bayesdamp.inference.deviation.single import Single, single
from bayesdamp.inference.deviation.weighing import START, weigh_all
from bayesdamp.inference.fit.mode import Mode, restore_mode
from bayesdamp.inference.fit.search import prior_starts
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.interface.fitting.case import Case, Starts
from bayesdamp.interface.fitting.specification import Specification
from bayesdamp.interface.records.signal import Signal
from bayesdamp.physics.restoring import LAWS
from bayesdamp.plugins import nearest
from bayesdamp.types import InputError, Refusal, Seed
from bayesdamp.units import UNITS

PRIOR_STARTS = 2
"""Draws from the prior that are climbed from beside what the record says."""


def checked(signal: object, model: object) -> Signal:
    """The signal as one of the interface's own. Raises InputError where one of the two is something else, or where the
    law is none for such a record."""
    if not isinstance(signal, types.Signal):
        raise InputError(
            f"signal is {type(signal).__name__}; it must be a Signal, such as read(...).signal() gives"
        )
    if not isinstance(model, Specification):
        raise InputError(f"model is {type(model).__name__}; it must be a Model")
    if UNITS[signal.unit].translates and not LAWS.get(model.restoring).translates:
        laws = ", ".join(n for n in LAWS.names() if LAWS.get(n).translates)
        what = f"is in {signal.unit}, a translation, which {model.restoring} is not"
        raise InputError(f"{signal.name}: {what}; restoring can be {laws}")
    return Signal.of(signal)


def deviating(case: Case, model: Specification) -> Single:
    """Fit a model with laws that may hold approximately. Raises Refusal where that cannot be done."""
    weighed = partial(
        single,
        damping=model.terms,
        restoring=model.restoring,
        known=model.known,
        priors=model.parameter_priors,
        reference=case.reference,
        noises=noises_of(model.noise),
    )
    average = not any(n in model.known for n in START)
    noises, priors = noises_of(model.noise), model.parameter_priors
    found = weighed(prepared_for(case.signal, noises, model.known, priors, average))
    averaging = averaging_of(found.weighing)
    if averaging is not None and not averaging.close and averaging.cycles <= MOST_CYCLES:
        found = weighed(prepared(case.signal, average=False))
    return found


def choose(case: Case, model: Specification) -> tuple[str, float | None, tuple[str, ...], Starts]:
    """Choose the noise model by its evidence under the model's own damping, where several are in play, and then the
    width of friction, where it is neither known nor inferred.

    Returns the noise model, friction's epsilon where one was chosen (rad/s), what is to be said of both, and where the
    fit that chose them ended. Raises Refusal.
    """
    names = model.noises
    if len(names) == 1:
        return names[0], None, (), {}
    own = {n: set(NOISES.get(n).parameters) for n in names}
    said = set.union(*own.values()) & {*model.known, *model.priors}
    usable = tuple(n for n in names if said <= own[n])
    candidate = Candidate(model.terms, model.restoring)
    with threadpool_limits(1, "blas"):
        weighing = weigh_all(
            prepared(case.signal, average=False),
            [candidate],
            known=model.system.known,
            priors=model.parameter_priors,
            reference=case.reference,
            approximate=False,
            noises=usable,
        )
    result = next((r for r in weighing.results), None)
    if result is None:
        raise Refusal(weighing.refused[candidate])
    epsilon, notes = None, []
    if weighing.frictions and "epsilon" not in model.priors:
        epsilon = weighing.epsilon
        notes.append(f"ε was not given; {epsilon:.3g} {case.signal.unit}/s suits the record best.")
    order = sorted(weighing.noise.weighed, key=lambda one: -one.log_evidence)
    if len(order) > 1:
        ahead = order[0].log_evidence - order[1].log_evidence
        notes.append(f"Noise: {order[0].name}, {ahead:.3g} nats ahead of {order[1].name}.")
    starts = {Seed("fit that chose the noise"): result.fit.parameters.named(result.fit.z)}
    return weighing.noise.likeliest, epsilon, tuple(notes), starts


def searched(
    case: Case, model: Specification, start: Mapping[str, float] | None, seed: int
) -> tuple[Target, Mode, tuple[str, ...]]:
    """The target, its highest mode with the solver's steps set right there, and what was chosen on the way."""
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
    noise, epsilon, notes, chosen = choose(case, model)
    target = case.target(noise, epsilon)
    seeds = {**chosen, **starts, **prior_starts(target, PRIOR_STARTS, seed)}
    mode = case.mode(target, seeds)
    # Made anew at the mode, as it is where a fit is read from a file, so that both are the same.
    return target, restore_mode(target, mode.stored), notes
