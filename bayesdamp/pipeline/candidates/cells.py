"""The cells of a candidate on a record: their keys, and the functions that compute them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayesdamp.estimators import ESTIMATORS, run as run_estimator
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.noise import NOISES
from bayesdamp.inference.samplers import SAMPLERS
from bayesdamp.interface.model import REGRESSION
from bayesdamp.outcomes import following
from bayesdamp.physics.damping import PAPER_TERMS, TERMS
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.answering import answer_key, likelihood_of
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.candidates.modes import compute_mode
from bayesdamp.pipeline.candidates.posteriors import compute_posterior
from bayesdamp.pipeline.candidates.sensitivity import compute_sensitivity, sensitivity_cells
from bayesdamp.pipeline.candidates.weighing import compute_evidence, evidence_parts
from bayesdamp.pipeline.records import signal_key
from bayesdamp.pipeline.tasks import Product, cell_seed, task_key, uses_library
from bayesdamp.serial import split
from bayesdamp.store.cells import Place
from bayesdamp.store.contents import EstimateContent
from bayesdamp.types import OK, Refusal


def compute_estimate(branch: Branch, method: str, seed: int) -> Product:
    """Run both stages of one estimator; the arrays are its curves."""
    use = branch.study.estimators
    stages = run_estimator(
        use.method(method),
        branch.record.signal,
        branch.problem,
        options=use.options.get(method),
        stages=use.stages,
        seed=seed,
    )
    trace = {f"{stage.stage}/{n}": np.asarray(v) for stage in stages for n, v in stage.trace.items()}
    return Product(EstimateContent(tuple(replace(stage, trace={}) for stage in stages)), trace)


SEEDED = {
    "estimate": compute_estimate,
    "posterior": compute_posterior,
    "evidence": compute_evidence,
    "sensitivity": compute_sensitivity,
}
"""The tasks that draw random numbers, with a seed that follows from the cell's name."""


def cells_of(branch: Branch) -> dict[str, str]:
    """Return the key of each cell by its name, in an order in which they can run."""
    study, spec, repeat, model = branch.study, branch.spec, branch.repeat, branch.model
    record_key = signal_key(study, spec, repeat, branch.store)
    forces = [*map(TERMS.source, branch.terms), LAWS.source(branch.restoring)]
    system = spec.under(branch.restoring)
    other = () if system is spec.system else (split(system),)
    use = study.estimators
    chosen = {n: dict(use.options.get(n, {})) for n in branch.methods}
    keys: dict[str, str] = {}
    for name, options in chosen.items():
        method = use.method(name)
        library = PAPER_TERMS if uses_library(method) else ()
        own = [ESTIMATORS.source(method), *map(TERMS.source, library), *forces]
        key = task_key("estimate", record_key, model, method, use.stages, options, own, *other)
        keys[f"estimate/{branch.path}/{name}"] = key
    settings = study.posterior
    if not (settings.samplers or study.evidence.methods):
        return keys
    priors = {t: str(study.models.prior.get(t)) for t in branch.terms}
    # The noise and the width of friction come from the answer, and so do the laws that hold approximately.
    answered = answer_key(study, spec, repeat, branch.store)
    named = [*forces, *map(NOISES.source, study.noises), ESTIMATORS.source(REGRESSION)]
    parts = (model, answered, priors, use.stages, chosen, *other)
    mode_key = task_key("mode", record_key, list(keys.values()), named, *parts)
    keys[f"mode/{branch.path}"] = mode_key
    density = (answered, model) if likelihood_of(study) == "law" else (mode_key,)
    length = (settings.chains, settings.warmup, settings.draws)
    for name in settings.samplers:
        key = task_key("posterior", *density, name, *length, SAMPLERS.source(name))
        keys[f"posterior/{branch.path}/{name}"] = key
    for name, parts in evidence_parts(study, branch.path, keys).items():
        own = [EVIDENCES.source(Place.of(name).method), SAMPLERS.source("nuts")]
        keys[name] = task_key("evidence", *density, *parts, own)
    for name, source in sensitivity_cells(branch, keys).items():
        keys[name] = task_key("sensitivity", *density, source, name)
    return keys


def compute(branch: Branch, name: str) -> Product:
    """Compute one cell. Raises Refusal where its record shows no oscillation, or a method cannot work on it."""
    record = branch.record.cell
    if record.outcome != OK:
        raise Refusal(following(record.name, record.outcome))
    place = Place.of(name)
    if place.kind == "mode":
        return compute_mode(branch)
    return SEEDED[place.kind](branch, place.method, cell_seed(branch.study, name))
