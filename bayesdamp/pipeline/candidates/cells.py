"""The cells of a candidate on a record: what each depends on, and which function computes it."""

from __future__ import annotations

from bayesdamp.estimators import ESTIMATORS
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.noise import NOISES
from bayesdamp.inference.samplers import SAMPLERS
from bayesdamp.interface.case import REGRESSION
from bayesdamp.outcomes import following
from bayesdamp.physics.damping import PAPER_TERMS, TERMS
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.candidates.estimates import compute_estimate
from bayesdamp.pipeline.candidates.modes import compute_mode
from bayesdamp.pipeline.candidates.posteriors import compute_posterior
from bayesdamp.pipeline.candidates.sensitivity import compute_sensitivity, sensitivity_cells
from bayesdamp.pipeline.candidates.weighing import compute_evidence, evidence_parts
from bayesdamp.pipeline.keys import task_key, uses_library
from bayesdamp.pipeline.records.answering import AnswerCell, likelihood_of
from bayesdamp.pipeline.records.records import cell_seed
from bayesdamp.pipeline.tasks import Product
from bayesdamp.store.cells import Place
from bayesdamp.types import OK, Refusal

SEEDED = {
    "estimate": compute_estimate,
    "posterior": compute_posterior,
    "evidence": compute_evidence,
    "sensitivity": compute_sensitivity,
}
"""What draws random numbers, of a seed that follows from the cell's name."""


def cells_of(branch: Branch) -> dict[str, str]:
    """Name of each cell to its key, in an order in which they can run."""
    found: dict[str, str] = {}
    use = branch.study.estimators
    chosen = {n: dict(use.options.get(n, {})) for n in branch.methods}
    for name, options in chosen.items():
        method = use.method(name)
        library = PAPER_TERMS if uses_library(method) else ()
        own = [ESTIMATORS.source(method), *map(TERMS.source, library), *branch.forces]
        key = task_key(
            "estimate", branch.parent.key, branch.model, method, use.stages, options, own, *branch.other
        )
        found[f"estimate/{branch.path}/{name}"] = key
    if not (branch.study.posterior.samplers or branch.study.evidence.methods):
        return found
    priors = {t: str(branch.study.models.prior.get(t)) for t in branch.terms}
    # The noise and the width of friction are the answer's; what may hold approximately is what its search found.
    answer = AnswerCell(branch.study, branch.spec, branch.repeat, branch.store)
    named = [*branch.forces, *map(NOISES.source, branch.study.noises), ESTIMATORS.source(REGRESSION)]
    parts = (branch.model, answer.key, priors, use.stages, chosen, *branch.other)
    mode_key = task_key("mode", branch.parent.key, list(found.values()), named, *parts)
    found[f"mode/{branch.path}"] = mode_key
    law = likelihood_of(branch.study) == "law"
    whence = (answer.key, branch.model) if law else (mode_key,)
    settings = branch.study.posterior
    for name in settings.samplers:
        length = (settings.chains, settings.warmup, settings.draws)
        key = task_key("posterior", *whence, name, *length, SAMPLERS.source(name))
        found[f"posterior/{branch.path}/{name}"] = key
    for name, parts in evidence_parts(branch.study, branch.path, found).items():
        own = [EVIDENCES.source(Place.of(name).method), SAMPLERS.source("nuts")]
        found[name] = task_key("evidence", *whence, *parts, own)
    for name, source in sensitivity_cells(branch, found).items():
        found[name] = task_key("sensitivity", *whence, source, name)
    return found


def compute(branch: Branch, name: str) -> Product:
    """Compute one cell. Raises Refusal where its record shows no oscillation, or a method cannot work on it."""
    if branch.record.cell.outcome != OK:
        raise Refusal(following(branch.parent.name, branch.record.cell.outcome))
    place = Place.of(name)
    if place.kind == "mode":
        return compute_mode(branch)
    return SEEDED[place.kind](branch, place.method, cell_seed(branch.study, name))
