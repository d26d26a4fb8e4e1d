"""Simulation-based calibration: draw records from the prior, and rank their true parameters among posterior draws.

If the posterior is right, all ranks are equally probable.
"""

import time
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from bayesdamp.config import Simulation, Study
from bayesdamp.estimators import run as run_estimator
from bayesdamp.inference.mode import Mode, find_mode
from bayesdamp.inference.model.target import Target, build_target
from bayesdamp.inference.noise import NOISES
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.interface.simulate import simulate_source
from bayesdamp.physics.damping import parse_model
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.tasks import Product, outcome_of_failure
from bayesdamp.priors import SHARED_SCALES, SHARED_SIGMAS, Prior
from bayesdamp.records.oscillation.features import Features, features
from bayesdamp.store.results import RanksContent
from bayesdamp.types import OK, Estimate, InputError, Problem, Reference, Refusal, Signal, System

ESTIMATOR = "least_squares"
"""The estimator from whose estimate a trajectory fit starts. The result of this fit, the refined estimate, is the start
of the search for the posterior mode."""
SECOND_ESTIMATOR = "envelope"
"""The search for the posterior mode has three further starts if the trajectory fit of `ESTIMATOR` does not succeed (its
outcome is not `ok`): this estimator's estimate, the initial estimate of `ESTIMATOR`, and the centre of the prior."""
SCALE_RANGE = (0.003, 0.1)
"""Range of the scale of the half-normal prior of equivalent damping ratios (`SharedHalfNormal`); the scale is itself a
damping ratio (1 is critical). A calibration uses only those of `SHARED_SCALES` that are in this range, to draw records
and to compute their posteriors and evidence. Below it noise hides the damping of most records; above it many records do
not oscillate."""
MOST_ESCAPES = 100
"""A prior is rejected if no record can be simulated with this many successive draws from it, for example because the
motions are unbounded (conventional)."""
Result = TypeVar("Result")
RECORDS_PER_TASK = 16
"""Number of records that one task (a computation whose result is stored) simulates and analyses."""
LIKELIHOOD = "log_likelihood"
"""Name of the log likelihood, which is ranked like a parameter. The rank of its value at the true parameters can show
an error that the rank of no parameter shows (Modrák et al., 2023)."""


@dataclass(frozen=True)
class DrawnRecord:
    """A simulated record whose true parameters were drawn from the prior, and a posterior density for it.

    truth: true values of all inferred parameters by name, in the units of the parameters (not scores). signal: the
    record. target: the posterior density for this record under the model that is fitted to it; after `Generator.draw`
    this is the model from which the record was drawn.
    """

    truth: Mapping[str, float]
    signal: Signal
    target: Target


@dataclass(frozen=True)
class Generator:
    """A generator of simulated records of one damping model, with parameters drawn from its priors.

    model: name of the damping model, such as "viscous+coulomb". source: the settings of the simulation; its damping
    terms, noise model and true values are not used. system: the restoring law, the known values and the priors of the
    parameters. blank: the posterior density for a placeholder of a record. Records are drawn from its priors, and
    replacing its signal by a record gives the posterior density for that record.
    """

    model: str
    source: Simulation
    system: System
    blank: Target

    def draw(self, rng: np.random.Generator, name: str) -> DrawnRecord:
        """Draw parameters from the prior, and return a record with this name that is simulated with them.

        The result is a `DrawnRecord`. `rng` draws the parameters and then the noise. If the simulation raises
        InputError, as for an unbounded motion, the parameters are drawn again. Such parameters have likelihood zero for
        every record, so leaving them out of the prior does not change the posterior.

        Raises
        ------
        InputError
            If the simulations with `MOST_ESCAPES` successive draws of the parameters fail.
        """
        escaped, osc = InputError("nothing was drawn"), self.blank.oscillator
        source = self.source.model_copy(update={"damping": osc.damping, "noise": self.blank.noise_model.name})
        for _ in range(MOST_ESCAPES):
            truth = {k: float(v) for k, v in self.blank.values(self.blank.prior_draws(1, rng)[0]).items()}
            try:
                signal = simulate_source(source, osc.restoring, {**self.blank.known, **truth}, name, rng)
            except InputError as fault:
                escaped = fault
                continue
            return DrawnRecord(truth, signal, replace(self.blank, signal=signal))
        raise InputError(
            f"{self.model}: no record could be simulated with {MOST_ESCAPES} successive draws from the prior; the last "
            f"error: {escaped}"
        )


def record_rng(seed: int, *labels: object) -> np.random.Generator:
    """Return the random number generator of one record, seeded by the study's seed and the record's labels.

    The labels, such as the model and the number of the record, are joined into one text. Equal arguments give equal
    random numbers.
    """
    return np.random.default_rng([seed, zlib.crc32("/".join(map(str, labels)).encode())])


def make_generator(
    study: Study, model: str, *, source: Simulation | None = None, priors: Mapping[str, Prior] | None = None
) -> Generator:
    """Return the generator of records of one model, simulated like the first signal of a study.

    Parameters
    ----------
    study
        The study.
    model
        The damping sum, such as "viscous+coulomb".
    source
        The settings of the simulation (duration, number of samples and so on); by default those of the first signal.
        Its damping terms, noise model and true values are not used.
    priors
        Priors, by parameter, that replace the prior or the known value that the study states for this parameter.

    Raises
    ------
    InputError
        If `model` is not a valid sum, the first signal is a file, the study has several noise models or one that
        depends on the record, no reference amplitude or frequency follows from the study, or the prior of a parameter
        would depend on the record.
    """
    spec = study.signals[0]
    if not isinstance(spec.source, Simulation):
        raise InputError(
            f"{study.source}: signal[{spec.name}] is read from a file; a calibration simulates all records, so the "
            "first signal must be simulated"
        )
    free = {**spec.system.free, **(priors or {})}
    known = {k: v for k, v in spec.system.known.items() if k not in free}
    system = replace(spec.system, known=known, free=free)
    reference = _reference(study, system)
    terms = parse_model(model)
    given = {t: p for t, p in study.models.prior.items() if t in terms}
    noise, *others = study.noises
    if others:
        raise InputError(
            f"{study.source}: posterior.noise names {1 + len(others)} models; calibration needs exactly one"
        )
    if NOISES.get(noise).constants:
        raise InputError(
            f"{study.source}: posterior.noise is {noise}, which depends on the record, so no record can be drawn "
            "from it; give another noise model"
        )
    empty = Signal(np.arange(3.0), np.zeros(3), spec.source.quantity, spec.source.unit)
    none = np.empty(0)
    any_record = (Features(x, x, x, x, x, x, x, x, none, none, none, none) for x in (1.0, 2.0))
    blank, other = (
        build_target(empty, terms, system, features, reference, noise=noise, term_priors=given)
        for features in any_record
    )
    dependent = [name for name in blank.names if blank.priors[name] != other.priors[name]]
    if dependent:
        raise InputError(
            f"{study.source}: the default prior of {' and '.join(dependent)} depends on the record, so nothing can be "
            f'drawn from it; give a prior in [system], such as {dependent[0]} = {{ prior = "normal", ... }}'
        )
    low, high = SCALE_RANGE
    pairs = zip(SHARED_SCALES, SHARED_SIGMAS, strict=True)
    scales = tuple(float(sigma) for ratio, sigma in pairs if low <= ratio <= high)
    system = replace(system, known=dict(blank.known))
    return Generator(model, source or spec.source, system, replace(blank, scales=scales))


def _reference(study: Study, system: System) -> Reference:
    """Return the reference amplitude and frequency, with which default priors scale, from the settings of a study.

    Raises InputError if one of them is neither stated nor follows from known parameters.
    """
    amplitude, frequency = system.amplitude, system.frequency
    if all(name in system.known for name in LAWS.get(system.restoring).parameters):
        law = Oscillator((), system.restoring)
        start = system.known.get("theta0", 0.0)
        frequency = frequency or law.natural_frequency(system.known, start)
        if "theta0" in system.known:
            amplitude = amplitude or abs(start - law.equilibrium(system.known, start)) or None
    if amplitude is None or frequency is None:
        name = "amplitude" if amplitude is None else "frequency"
        raise InputError(
            f"{study.source}: system.{name} is missing; the widths of default priors scale with it, and a value from a "
            "record would make the prior depend on the data; give a positive number"
        )
    return Reference(amplitude, frequency)


def mode_of(drawn: DrawnRecord, system: System) -> tuple[Mode, Estimate]:
    """Return the posterior mode of a record, and its refined estimate.

    The refined estimate is the trajectory fit that starts at the estimate of `ESTIMATOR`; it has no values if this fit
    failed. The search for the mode starts from estimates that follow from the record, or from the centre of the prior,
    never from the true values. system: the known values and priors that the estimators use.

    Raises
    ------
    Refusal
        If the record shows no oscillation, or the search finds no mode from any starting point.
    """
    roughness = features(drawn.signal).roughness
    problem = Problem(drawn.target.oscillator.damping, system)
    first = run_estimator(ESTIMATOR, drawn.signal, problem, seed=0)
    refined = first[-1]
    starts = [refined.values] if refined.values else []
    if refined.outcome != OK:
        second = run_estimator(SECOND_ESTIMATOR, drawn.signal, problem, stages=["initial"], seed=0)
        starts += [e.values for e in (*first[:-1], *second) if e.values]
        starts.append({})  # the centre of the prior
    return find_mode(drawn.target, starts, noise_level=roughness), refined


def run_safely(compute: Callable[..., Result], *arguments: object) -> tuple[Result | None, str]:
    """Call a function; return its result and OK, or None and a text that says why it failed.

    The text is the message of a Refusal, or "failed: TYPE: FIRST LINE OF MESSAGE" for another exception. InputError and
    the OSError of a full disk are raised to the caller. If BAYESDAMP_DEBUG is set, every exception except Refusal is
    raised.
    """
    try:
        return compute(*arguments), OK
    except Refusal as refusal:
        return None, str(refusal)
    except Exception as fault:
        return None, outcome_of_failure(fault)


def compute_chunk(study: Study, model: str, first: int) -> Product:
    """Draw the records of one task, numbered from `first`, and rank their true parameters among posterior draws.

    Returns
    -------
    Product
        The content is a `RanksContent` with the outcome of each record and the names of the k quantities: the
        parameters, and last the log likelihood. The arrays are for c = `RECORDS_PER_TASK` records and s samplers, in
        the units of the parameters (nats for the log likelihood). truth (c, k): the true values; NaN for the log
        likelihood if the record has no posterior mode. value and stderr (c, k): the refined estimate and its standard
        errors; NaN where missing, as for the log likelihood. ranks (c, s, k): number of thinned draws below the true
        value, 0 to calibration.draws; −1 if the sampler gave no draws. below (c, s, k): fraction of all draws below the
        true value; NaN if there are no draws.
    """
    source, table, p = make_generator(study, model), study.calibration, study.posterior
    names = [*source.blank.names, LIKELIHOOD]
    outcomes, modes, began = [OK] * RECORDS_PER_TASK, dict[int, tuple[Target, Mode]](), time.perf_counter()
    truth = np.full((RECORDS_PER_TASK, len(names)), np.nan)
    value, stderr = np.full((2, RECORDS_PER_TASK, len(names)), np.nan)
    for i in range(RECORDS_PER_TASK):
        drawn = source.draw(record_rng(study.seed, model, first + i), f"{model}-{first + i}")
        truth[i, :-1] = [drawn.truth[n] for n in names[:-1]]
        fit, outcomes[i] = run_safely(mode_of, drawn, source.system)
        if fit is None:
            continue
        mode, refined = fit
        modes[i] = drawn.target, mode
        truth[i, -1] = mode.likelihood.log_likelihood(drawn.target.scores(drawn.truth))
        value[i] = [refined.values.get(n, np.nan) for n in names]
        stderr[i] = [refined.stderr.get(n, np.nan) for n in names]
    seconds = {"record": time.perf_counter() - began}
    shape = (RECORDS_PER_TASK, len(table.samplers), len(names))
    ranks, below = np.full(shape, -1), np.full(shape, np.nan)
    sampler_outcomes = {sampler: [""] * RECORDS_PER_TASK for sampler in table.samplers}
    for s, sampler in enumerate(table.samplers):
        began = time.perf_counter()
        for i, (target, mode) in modes.items():
            seed = int(record_rng(study.seed, model, first + i, sampler).integers(2**31 - 2))
            settings = Settings(p.chains, p.warmup, p.draws, seed)
            posterior, outcome = run_safely(SAMPLERS.get(sampler).sample, target, mode, settings)
            sampler_outcomes[sampler][i] = posterior.outcome if posterior else outcome
            if posterior:
                draws = [*np.moveaxis(posterior.draws, -1, 0), posterior.log_likelihood]
                ranks[i, s] = [np.sum(thin(d, table.draws) < t) for t, d in zip(truth[i], draws)]
                below[i, s] = [np.mean(d < t) for t, d in zip(truth[i], draws)]
        seconds[sampler] = time.perf_counter() - began
    content = RanksContent(
        tuple(outcomes),
        tuple(outcome == OK for outcome in outcomes),
        first,
        model=model,
        names=tuple(names),
        sampler_outcomes={sampler: tuple(each) for sampler, each in sampler_outcomes.items()},
        seconds=seconds,
    )
    arrays = {"truth": truth, "value": value, "stderr": stderr, "ranks": ranks, "below": below}
    return Product(content, arrays, seconds=sum(seconds.values()))


def check(study: Study) -> None:
    """Check, before anything is computed, that the study can be calibrated.

    Raises
    ------
    InputError
        If `make_generator` cannot draw records of a model, or calibration.draws is more than the draws of a posterior.
    """
    for model in study.compare(study.signals[0]):
        make_generator(study, model)
    p, table = study.posterior, study.calibration
    if p.chains * p.draws < table.draws:
        raise InputError(
            f"{study.source}: calibration.draws is {table.draws}; it must be at most the {p.chains * p.draws} draws "
            "of [posterior]"
        )


def key_parts(study: Study) -> dict[str, Any]:
    """Return the settings, by name, on which the result of a task depends.

    The model and the number of the task's first record, on which it depends too, are not included.
    """
    table, resolved = study.calibration, study.resolved()
    return {
        "signal": resolved["signals"][0],
        "prior": resolved["models"]["prior"],
        "posterior": {k: v for k, v in resolved["posterior"].items() if k != "samplers"},
        "samplers": table.samplers,
        "draws": table.draws,
        "seed": study.seed,
    }


def thin(draws: np.ndarray, count: int) -> np.ndarray:
    """Select `count` draws that are spread evenly over all chains; return them, (count,).

    draws: values of one quantity, (chain, draw). The chains are joined one after the other; the first and the last draw
    are included.
    Raises ValueError if there are fewer than `count` draws.
    """
    flat = draws.reshape(-1)
    if flat.size < count:
        raise ValueError(f"{count} thinned draws are needed, but there are only {flat.size} draws")
    return flat[np.round(np.linspace(0, flat.size - 1, count)).astype(int)]
