"""What a study leaves out as it goes: laws and candidates far behind, and posteriors of all but the best."""

from __future__ import annotations

import math
from collections.abc import Mapping

from bayesdamp.config import SignalSpec, Study
from bayesdamp.outcomes import Status, status_of
from bayesdamp.pipeline.keys import digest
from bayesdamp.pipeline.records.answering import likelihood_of, shortlist
from bayesdamp.store import CellResult, Store
from bayesdamp.store.contents.evidence import EvidenceContent
from bayesdamp.types import OK, candidate_parts

LAW_MARGIN = 40.0
"""Nats beyond `prune` by which a law's richest damping must be behind before its other dampings are left out. Each of
them fits no better; what it can gain is the Occam factors of the terms it lacks, some ten nats each at most."""
FAR = 5.0
"""Nats behind the best, beyond which a candidate that is not sampled is not looked at under other circumstances."""
FAR_AT_ONCE = Status.PRUNED.because("far behind in the first weighing")
NOT_SAMPLED = Status.NOT_SAMPLED.because("not among the best by evidence")


def staged(study: Study) -> bool:
    """Whether what is computed depends on what was found before."""
    return study.models.prune is not None or study.posterior.best is not None


def heads(study: Study, spec: SignalSpec) -> tuple[str, ...]:
    """The candidate of each law with the most damping terms."""
    found: dict[str, str] = {}
    for name in study.compare(spec):
        damping, law = candidate_parts(name)
        if law not in found or damping.count("+") > found[law].count("+"):
            found[law] = name
    return tuple(found.values())


def looked(
    study: Study, spec: SignalSpec, repeat: int, store: Store, names: tuple[str, ...]
) -> dict[str, float]:
    """Laplace's log evidence of the candidates that have one."""
    found = {}
    for name in names:
        value = _log_evidence(store, spec, repeat, name, "laplace")
        if math.isfinite(value):
            found[name] = value
    return found


def listed(study: Study, spec: SignalSpec, repeat: int, store: Store) -> dict[str, str]:
    """All candidates, each with why the first weighing leaves it out, or an empty sentence."""
    short = None
    if study.models.prune is not None:
        short = shortlist(store, spec.name, repeat, study.models.prune, likelihood_of(study) == "law")
    found = {}
    for name in study.compare(spec):
        damping, law = candidate_parts(name)
        out = short is not None and (damping, law or spec.restoring[0]) not in short
        found[name] = FAR_AT_ONCE if out else ""
    return found


def laws_left(study: Study, spec: SignalSpec, repeat: int, store: Store) -> dict[str, str]:
    """Candidates other than the heads, each with why its law is out of the question, or an empty sentence."""
    tops = heads(study, spec)
    logs = looked(study, spec, repeat, store, tops)
    best = max(logs.values(), default=math.nan)
    found = {}
    for name in study.compare(spec):
        if name in tops:
            continue
        earlier = _outcome(store, f"evidence/{spec.name}/{repeat}/{name}/laplace")
        if earlier == FAR_AT_ONCE:
            found[name] = earlier
            continue
        head = next(t for t in tops if candidate_parts(t)[1] == candidate_parts(name)[1])
        behind = best - logs.get(head, math.nan)
        covered = set(candidate_parts(name)[0].split("+")) <= set(candidate_parts(head)[0].split("+"))
        out = study.models.prune is not None and covered and behind > study.models.prune + LAW_MARGIN
        found[name] = (
            Status.PRUNED.because("its restoring law is far behind with all damping terms already")
            if out
            else ""
        )
    return found


def candidates_left(study: Study, spec: SignalSpec, repeat: int, store: Store) -> dict[str, str]:
    """All candidates, each with why it is not weighed further, or an empty sentence."""
    names = study.compare(spec)
    logs = looked(study, spec, repeat, store, names)
    best = max(logs.values(), default=math.nan)
    limit = study.models.prune
    found = {}
    for name in names:
        earlier = _outcome(store, f"evidence/{spec.name}/{repeat}/{name}/laplace")
        if status_of(earlier) is Status.PRUNED:
            found[name] = earlier
        elif limit is not None and name in logs and best - logs[name] > limit:
            found[name] = Status.PRUNED.because(
                f"log Bayes factor to the best below −{limit:g} by Laplace's approximation"
            )
        else:
            found[name] = ""
    return found


def best_of(study: Study, spec: SignalSpec, repeat: int, store: Store) -> tuple[str, ...]:
    """The candidates whose posterior is sampled, the best first; all where the study sets no number.

    Beside the best they are those not far behind whose evidence is not to be trusted: bridge sampling and the referee
    start from draws.
    """
    if study.posterior.best is None:
        return study.compare(spec)
    found = _heights(study, spec, repeat, store)
    order, top = tuple(found), max(found.values(), default=math.nan)
    doubtful = [
        n
        for n in order[study.posterior.best :]
        if top - found[n] < FAR and _doubtful(study, spec, repeat, store, n)
    ]
    return (*order[: study.posterior.best], *doubtful)


def likely(study: Study, spec: SignalSpec, repeat: int, store: Store) -> tuple[str, ...]:
    """Those of which it is told what their evidence depends on: the sampled ones, and all that are not far behind."""
    best = best_of(study, spec, repeat, store)
    found = _heights(study, spec, repeat, store)
    top = max(found.values(), default=math.nan)
    return tuple(dict.fromkeys([*best, *(n for n, height in found.items() if top - height < FAR)]))


def _heights(study: Study, spec: SignalSpec, repeat: int, store: Store) -> dict[str, float]:
    """The candidates that are left, the best first, with their log evidence."""
    left = [n for n, why in candidates_left(study, spec, repeat, store).items() if not why]
    order = [m for m in study.evidence.methods if m != "laplace"] + ["laplace"]

    def height(name: str) -> float:
        values = (_log_evidence(store, spec, repeat, name, method) for method in order)
        return next((v for v in values if math.isfinite(v)), -math.inf)

    return dict(sorted(((n, height(n)) for n in left), key=lambda item: -item[1]))


def set_aside(store: Store, cells: Mapping[str, str], why: str) -> None:
    """Store a sentence in the place of each of these cells, by name and key."""
    for name, key in cells.items():
        if not store.has(name, aside := digest(why, key)):
            store.write(CellResult(name, aside, outcome=why))


def _log_evidence(store: Store, spec: SignalSpec, repeat: int, name: str, method: str) -> float:
    try:
        cell = store.read(f"evidence/{spec.name}/{repeat}/{name}/{method}")
    except KeyError:
        return math.nan
    found = EvidenceContent.of(cell).log_evidence
    return math.nan if found is None else found


def _doubtful(study: Study, spec: SignalSpec, repeat: int, store: Store, name: str) -> bool:
    """Whether a method that has an error was tried on a candidate and is not to be trusted."""
    tried = [m for m in study.evidence.methods if m != "laplace"]
    said = [_outcome(store, f"evidence/{spec.name}/{repeat}/{name}/{method}") for method in tried]
    return any(status_of(one) not in (Status.OK, Status.NOT_SAMPLED, Status.PRUNED) for one in said)


def _outcome(store: Store, name: str) -> str:
    try:
        return store.read(name).outcome
    except KeyError:
        return OK
