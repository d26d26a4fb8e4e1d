"""Find the highest posterior mode of a candidate (model) from all estimates as starting points, and check its fit."""

import numpy as np

from bayesdamp.inference.checks import check_fit
from bayesdamp.inference.mode import group_searches
from bayesdamp.interface.fit import Fit
from bayesdamp.interface.model import Starts
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.records import NOT_APPLICABLE
from bayesdamp.pipeline.tasks import Product, task_seed
from bayesdamp.serial import split
from bayesdamp.store.results import EstimateContent, ModeContent
from bayesdamp.types import Refusal


def starts_of(candidate: StudyCandidate) -> Starts:
    """Return the starting points of the search for the mode: the finite estimates by all estimators at all stages.

    Each is a mapping from the names of parameters to their values.
    """
    results = [candidate.store.read(f"estimate/{candidate.path}/{method}") for method in candidate.methods]
    stages = [stage.values for result in results for stage in EstimateContent.of(result).stages]
    return [values for values in stages if values and np.all(np.isfinite(list(values.values())))]


def compute_mode(candidate: StudyCandidate) -> Product:
    """Search for the highest posterior mode of a candidate, and check its fit.

    The content of the result is a `ModeContent`. The arrays are the times `t` in s, the motion `fit` and the `residual`
    in the base unit of the record, the `whitened` residuals, their `autocorrelation`, and the arrays of the mode itself
    (`stored/...`). Raises Refusal if the search finds no mode, or if the record has no noise.
    """
    if not candidate.record.content.noisy:
        raise Refusal(NOT_APPLICABLE)
    mode, _ = candidate.case.mode((candidate.noise,), candidate.epsilon, starts_of(candidate))
    fit, target = Fit.at_mode(candidate.record.signal, candidate.case.model, mode), mode.likelihood.target
    seed = task_seed(candidate.study, f"checks/{candidate.spec.name}/{candidate.repeat}")
    checks, residuals = check_fit(target, mode, candidate.record.features.period, seed)
    arrays = {"t": candidate.record.signal.t, **residuals}
    # Later tasks read the mode from its stored result, never from memory. The solver then chooses its step sizes again,
    # which changes log evidence by about 1e-8 nats. So an interrupted run, which must read it, gives the same numbers.
    content = {
        **vars(checks),
        "shares": [share for _, share in group_searches(mode)],
        "values": fit.values,
        "sd": fit.sd,
        "known": fit.known,
        "priors": {n: p.describe() for n, p in fit.priors.items()},
        "log_posterior": mode.log_posterior,
        "stored": split(mode.stored, arrays, "stored"),
    }
    return Product(ModeContent.of_meta(split(content)), arrays)
