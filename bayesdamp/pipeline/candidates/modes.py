"""Find the highest posterior mode of a candidate from all available starts, and check its fit."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.checks import check_fit
from bayesdamp.inference.search import group_searches
from bayesdamp.interface.fit import Fit
from bayesdamp.interface.model import (
    PRIOR_STARTS,
    Starts,
    start_from_all_terms,
    start_from_features,
    start_from_regression,
)
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.records import NOT_APPLICABLE
from bayesdamp.pipeline.tasks import Product, task_seed
from bayesdamp.serial import split
from bayesdamp.store.contents import EstimateContent, ModeContent
from bayesdamp.types import Refusal


def starts_of(candidate: StudyCandidate) -> Starts:
    """Return the starting points of the search for the mode: parameter values by name.

    They are values from the record's frequency and decay, and the finite values of every estimator at each of its
    stages. If no estimator has finite values, the estimates of least squares are used. With many candidates
    (`has_many_rivals`), the fit of all terms in the answer is a starting point too. Raises Refusal if there is no
    starting point.
    """
    results = [candidate.store.read(f"estimate/{candidate.path}/{method}") for method in candidate.methods]
    stages = [stage.values for result in results for stage in EstimateContent.of(result).stages]
    starts: Starts = [values for values in stages if values and np.all(np.isfinite(list(values.values())))]
    problem = candidate.problem
    if not starts:
        starts, _ = start_from_regression(candidate.record.signal, problem)
    decays = start_from_features(candidate.record.signal, candidate.record.features, problem)
    starts = [*decays, *starts]
    fit = (
        candidate.answer.fits.get(candidate.restoring)
        if candidate.has_many_rivals and candidate.answer
        else None
    )
    if candidate.answer and fit:
        starts = [start_from_all_terms(fit, candidate.answer.terms, problem, decays), *starts]
    if not starts:
        raise Refusal("no estimator returned values from which the search for the mode could start")
    return starts


def compute_mode(candidate: StudyCandidate) -> Product:
    """Return the highest posterior mode that is found, with the checks of its fit.

    The content is a `ModeContent`. The arrays are the times `t` in s, the motion `fit` and the `residual` in the unit
    of the record, the whitened residuals and their autocorrelation, and the mode itself. Raises Refusal if the search
    finds none, or if the record has no noise.
    """
    if not candidate.record.content.noisy:
        raise Refusal(NOT_APPLICABLE)
    mode = candidate.case.mode(
        candidate.noise,
        candidate.epsilon,
        starts_of(candidate),
        draws=0 if candidate.has_many_rivals else PRIOR_STARTS,
        seed=task_seed(candidate.study, f"seeds/{candidate.path}"),
        thrifty=candidate.has_many_rivals,
    )
    fit, target = Fit.at_mode(candidate.record.signal, candidate.case.model, mode), mode.likelihood.target
    seed = task_seed(candidate.study, f"checks/{candidate.spec.name}/{candidate.repeat}")
    checks, residuals = check_fit(target, mode, candidate.record.features.period, seed)
    arrays = {"t": candidate.record.signal.t, **residuals}
    # Later tasks read the mode from its stored result, never from memory: the step sizes of the solver are then chosen
    # again, which changes evidence by some 1e-8 nats, and an interrupted run must give the same numbers.
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
