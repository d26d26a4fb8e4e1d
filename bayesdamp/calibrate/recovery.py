"""Model recovery: draw a damping model and a record of it, and compute the probabilities of all models.

If the probabilities are right, models with the probability p are the true ones in the fraction p of the records.
"""

import time
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from scipy.special import logsumexp

from bayesdamp.calibrate.ranks import DrawnRecord, Generator, make_generator, mode_of, record_rng, run_safely
from bayesdamp.config import Simulation, Study
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.pipeline.tasks import Product
from bayesdamp.priors import LogNormal
from bayesdamp.store.results import RecoveryContent
from bayesdamp.types import OK, InputError, Refusal

RECORDS_PER_TASK = 4
"""Number of records that one task (a computation whose result is stored) simulates and analyses."""


def compute_chunk(study: Study, series: str, first: int) -> Product:
    """Draw the records of one task, numbered from `first`, and compute the probabilities of the models.

    series: name of the series of records, which determines their random numbers together with the study's seed.

    Returns
    -------
    Product
        The content is a `RecoveryContent`. The arrays are for c = `RECORDS_PER_TASK` records and the m models in
        `models` of the content. model (c,): index of the true model, from 0. probability (c, m): probability of each
        model, with equal prior probabilities. log_evidence (c, m): in nats. design (c, 2): the median of the noise's sd
        (fraction of the reference amplitude) and the number of cycles. A record whose outcome is not `ok` is not used:
        all its probabilities are NaN, and so is the evidence of the model that failed and of those after it.
    """
    models, began = study.models.compare, time.perf_counter()
    outcomes = [OK] * RECORDS_PER_TASK
    evidence_outcomes = [[""] * len(models) for _ in range(RECORDS_PER_TASK)]
    truth = np.zeros(RECORDS_PER_TASK, int)
    design = np.full((RECORDS_PER_TASK, 2), np.nan)
    evidence = np.full((RECORDS_PER_TASK, len(models)), np.nan)
    for i in range(RECORDS_PER_TASK):
        number = first + i
        design[i] = design_of(study, number)
        generators = _generators(study, *design[i])
        rng = record_rng(study.seed, series, number)
        truth[i] = rng.integers(len(models))
        drawn = generators[truth[i]].draw(rng, f"{series}-{number}")
        for m, source in enumerate(generators):
            labels = (series, number, source.model)
            result, outcomes[i] = run_safely(_evidence, study, source, drawn, labels)
            if result is None:
                break
            evidence[i, m], evidence_outcomes[i][m] = result
    content = RecoveryContent(
        tuple(outcomes),
        tuple(outcome == OK for outcome in outcomes),
        first,
        models=tuple(models),
        evidence_outcomes=tuple(map(tuple, evidence_outcomes)),
    )
    arrays = {
        "model": truth,
        "log_evidence": evidence,
        "probability": np.exp(evidence - logsumexp(evidence, axis=1, keepdims=True)),
        "design": design,
    }
    return Product(content, arrays, seconds=time.perf_counter() - began)


def design_of(study: Study, number: int) -> tuple[float, float]:
    """Return the noise (fraction of the reference amplitude) and the number of cycles of record `number`, from 0.

    The noise is the median of the distribution from which the sd of the record's noise is drawn. A cycle has the
    reference frequency. Successive records use all combinations of the study's noise levels and numbers of cycles in
    turn.
    """
    levels = list(product(study.recovery.noise, study.recovery.cycles))
    return levels[number % len(levels)]


def _generators(study: Study, noise: float, cycles: float) -> list[Generator]:
    """Return a generator of records for each model of the study, in the order of the models.

    noise: fraction of the reference amplitude that is the median of the noise's standard deviation, which has a
    log-normal prior. cycles: duration of the records, in cycles of the reference frequency.

    Raises
    ------
    InputError
        If the study's first signal is not simulated, or states no reference amplitude or frequency. Also if
        `make_generator` cannot draw records of a model: if the study has several noise models or one that depends on
        the record, or if the prior of a parameter would depend on the record.
    """
    table, system, source = study.recovery, study.signals[0].system, study.signals[0].source
    if not isinstance(source, Simulation) or system.amplitude is None or system.frequency is None:
        raise InputError(
            f"{study.source}: calibrate --models needs a simulated first signal, and amplitude and frequency in "
            "[system]; they determine the noise and the duration of the records"
        )
    duration = 2 * np.pi * cycles / system.frequency
    source = source.model_copy(update={"duration": duration, "samples": table.samples})
    prior = {"noise_sd": LogNormal(median=noise * system.amplitude, sigma=table.noise_sigma)}
    return [make_generator(study, m, source=source, priors=prior) for m in study.models.compare]


def _evidence(
    study: Study, source: Generator, drawn: DrawnRecord, labels: tuple[object, ...]
) -> tuple[float, str]:
    """Return the log evidence (nats) of one model for a record, by importance sampling, and the outcome of this method.

    source: the generator of the model whose evidence is computed. drawn: the record, from this or any other model; its
    true values are not used. labels: values that determine the random numbers, together with the study's seed. Raises
    Refusal if the record shows no oscillation, no mode is found, or the evidence is not finite.
    """
    assumed = replace(drawn, target=replace(source.blank, signal=drawn.signal))
    mode, _ = mode_of(assumed, source.system)
    seed = int(record_rng(study.seed, *labels).integers(2**31 - 1))
    evidence = EVIDENCES.get("importance").evidence(source.model, assumed.target, mode, seed)
    if not np.isfinite(evidence.log_evidence):
        raise Refusal(f"{source.model}: the evidence is not finite")
    return evidence.log_evidence, evidence.outcome


def check(study: Study) -> None:
    """Check that records of the study's models can be drawn; it is called before anything is computed.

    Raises
    ------
    InputError
        If there are fewer than two models to compare, or if records of one of them cannot be drawn (see `_generators`).
    """
    if len(study.models.compare) < 2:
        raise InputError(f"{study.source}: models.compare names fewer than two models; give two or more")
    _generators(study, *design_of(study, 0))


def key_parts(study: Study) -> dict[str, Any]:
    """Return the settings, by name, on which the result of a task depends.

    The number of the task's first record, on which it depends too, is not included.
    """
    resolved = study.resolved()
    return {
        "signal": resolved["signals"][0],
        "models": resolved["models"],
        "noise": study.posterior.noise,
        "recovery": study.recovery.model_dump(exclude={"records"}),
        "seed": study.seed,
    }
