"""A candidate on the records of one specimen where laws hold approximately: from where each record's answer ended."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import ParamSpec, TypeVar

import numpy as np

from bayesdamp.inference.approximate.joined import Joined
from bayesdamp.inference.deviation.sampled.marginal import marginal_of
from bayesdamp.inference.deviation.single import Single, under
from bayesdamp.inference.many.record import Record
from bayesdamp.inference.model.defaults import Reference, default_prior
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.pipeline.candidates.approximate import law_on
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.records.answering import answer_cell, priors_given
from bayesdamp.store.contents.answers import AnswerContent
from bayesdamp.types import Refusal

P = ParamSpec("P")
T = TypeVar("T")


def joined_on(
    branches: Sequence[Branch], labels: Sequence[str], reference: Reference
) -> tuple[list[Record], list[Mapping[str, float]]]:
    """The records, with values at each one's own best motion.

    reference: of the priors of all; the width of friction's turning over is the geometric mean of the records'. Raises
    Refusal where the search on a record found no motion under the candidate.
    """
    every = [_of(label, law_on, branch).single for label, branch in zip(labels, branches, strict=True)]
    epsilon = float(np.exp(np.mean([np.log(one.found.epsilon) for one in every])))
    records: list[Record] = []
    starts: list[Mapping[str, float]] = []
    for label, branch, one in zip(labels, branches, every, strict=True):
        again = _of(label, _under, branch, one, reference, epsilon)
        records.append(Joined(_of(label, marginal_of, again.weighing, again.result)))
        parameters = again.result.fit.parameters
        starts.append(parameters.named(again.found.u[: parameters.free.size]))
    return records, starts


def _of(label: str, make: Callable[P, T], *given: P.args, **more: P.kwargs) -> T:
    """What is made of a record; a refusal says of which."""
    try:
        return make(*given, **more)
    except Refusal as refusal:
        raise Refusal(f"{label}: {refusal}") from None


def _under(branch: Branch, one: Single, reference: Reference, epsilon: float) -> Single:
    """A record's candidate under the priors of a reference, where the study gives none."""
    given = priors_given(branch.study, branch.spec, branch.record)
    oscillator, features = Oscillator(branch.terms, branch.restoring), one.weighing.data.features
    priors = {
        n: given[n] if n in given else default_prior(n, oscillator, "gaussian", reference, features)
        for n in one.found.priors
    }
    return under(one, priors, epsilon)


def answered_logs(branches: Sequence[Branch]) -> dict[str, float]:
    """Log evidence of the candidates of one record that its answer weighed with deviations."""
    first = branches[0]
    cell = answer_cell(first.store, first.spec.name, first.repeat)
    rows = AnswerContent.of(cell).candidates if cell is not None else ()
    found = {(frozenset(r.damping.split("+")), r.restoring): r.log_evidence for r in rows}
    logs = {b.model: found.get((frozenset(b.terms), b.restoring)) for b in branches}
    return {model: value for model, value in logs.items() if value is not None}
