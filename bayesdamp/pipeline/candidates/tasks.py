"""List the tasks of a candidate on a record with their keys, and compute them.

A candidate is a sum of damping terms under a restoring law.
"""

from bayesdamp.estimators import ESTIMATORS, run as run_estimator
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.noise import NOISES
from bayesdamp.inference.samplers import SAMPLERS
from bayesdamp.physics.damping import PAPER_TERMS, TERMS
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.answering import answer_key
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.candidates.evidence import compute_evidence, evidence_parts
from bayesdamp.pipeline.candidates.modes import compute_mode
from bayesdamp.pipeline.candidates.posteriors import compute_posterior
from bayesdamp.pipeline.tasks import Product, task_key, task_seed
from bayesdamp.serial import split
from bayesdamp.sources import import_closure
from bayesdamp.store.results import EstimateContent, TaskName
from bayesdamp.types import OK, Refusal, following


def compute_estimate(candidate: StudyCandidate, method: str, seed: int) -> Product:
    """Run one estimator on a record: its own (initial) estimate, and the trajectory fit that starts from it.

    Only the stages that the study names are run. The content of the result is an `EstimateContent`. method: name of an
    estimator, or of a variant of an estimator that the study defines.
    """
    use = candidate.study.estimators
    stages = run_estimator(
        use.method(method),
        candidate.record.signal,
        candidate.problem,
        options=use.options.get(method),
        stages=use.stages,
        seed=seed,
    )
    return Product(EstimateContent(tuple(stages)))


COMPUTE = {"estimate": compute_estimate, "posterior": compute_posterior, "evidence": compute_evidence}
"""The functions that compute tasks, by kind of task. Their arguments are the candidate, the name of the method and the
random seed. Tasks of the kind "mode", which have no method, are not included: `compute` computes them directly."""


def task_keys(candidate: StudyCandidate) -> dict[str, str]:
    """Return the names of all tasks of a candidate with their keys, in an order in which the tasks can be computed.

    A key is the hash of the task's inputs and code. The tasks themselves are not computed. A study without samplers and
    evidence methods has only the estimates.
    """
    study, spec, model, record_key = candidate.study, candidate.spec, candidate.model, candidate.record.key
    forces = [*map(TERMS.source, candidate.terms), LAWS.source(candidate.restoring)]
    system = spec.under(candidate.restoring)
    other = () if system is spec.system else (split(system),)
    use = study.estimators
    chosen = {n: dict(use.options.get(n, {})) for n in candidate.methods}
    keys: dict[str, str] = {}
    for name, options in chosen.items():
        method = use.method(name)
        # Some estimators regress on these terms too, although they do not estimate them.
        modules = import_closure([f"bayesdamp.estimators.methods.{method}"])
        library = PAPER_TERMS if "bayesdamp.estimators.regression" in modules else ()
        own = [ESTIMATORS.source(method), *map(TERMS.source, library), *forces]
        key = task_key("estimate", record_key, model, method, use.stages, options, own, *other)
        keys[f"estimate/{candidate.path}/{name}"] = key
    settings = study.posterior
    if not (settings.samplers or study.evidence.methods):
        return keys
    priors = {t: str(study.models.prior.get(t)) for t in candidate.terms}
    # The noise model, the velocity ε of friction and deviations from the laws are taken from the answer.
    answered = answer_key(candidate.record)
    named = [*forces, *map(NOISES.source, study.noises)]
    parts = (model, answered, priors, use.stages, chosen, *other)
    mode_key = task_key("mode", record_key, list(keys.values()), named, *parts)
    keys[f"mode/{candidate.path}"] = mode_key
    density = (answered, model) if study.likelihood == "law" else (mode_key,)
    length = (settings.chains, settings.warmup, settings.draws)
    for name in settings.samplers:
        key = task_key("posterior", *density, name, *length, SAMPLERS.source(name))
        keys[f"posterior/{candidate.path}/{name}"] = key
    for name, parts in evidence_parts(study, candidate.path, keys).items():
        own = [EVIDENCES.source(TaskName.of(name).method), SAMPLERS.source("nuts")]
        keys[name] = task_key("evidence", *density, *parts, own)
    return keys


def compute(candidate: StudyCandidate, name: str) -> Product:
    """Compute the task with this name, such as `mode/bench/0/viscous`, and return its result without storing it.

    Raises Refusal if the outcome of the record is not OK, if there is no mode or fit to start from, or if the method is
    not applicable to the record.
    """
    record = candidate.record.result
    if record.outcome != OK:
        raise Refusal(following(record.name, record.outcome))
    parts = TaskName.of(name)
    if parts.kind == "mode":
        return compute_mode(candidate)
    return COMPUTE[parts.kind](candidate, parts.method, task_seed(candidate.study, name))
