"""What a study leaves out as it goes: candidates far behind, and posteriors of all but the best."""

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

FAR = 5.0
"""Nats behind the best, beyond which a candidate that is not sampled is not looked at under other circumstances."""
FAR_AT_ONCE = Status.PRUNED.because("far behind in the first weighing")
NOT_SAMPLED = Status.NOT_SAMPLED.because("not among the best by evidence")


class Contest:
    """The candidates on one record, as a study leaves some of them out on its way."""

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, store: Store) -> None:
        self.study, self.spec, self.repeat, self.store = study, spec, repeat, store
        self.names, self.limit = study.compare(spec), study.models.prune

    def listed(self) -> dict[str, str]:
        """All candidates, each with why the first weighing leaves it out, or an empty sentence."""
        short = None
        if self.limit is not None:
            law = likelihood_of(self.study) == "law"
            short = shortlist(self.store, self.spec.name, self.repeat, self.limit, law)
        found = {}
        for name in self.names:
            damping, law = candidate_parts(name)
            out = short is not None and (damping, law or self.spec.restoring[0]) not in short
            found[name] = FAR_AT_ONCE if out else ""
        return found

    def candidates_left(self) -> dict[str, str]:
        """All candidates, each with why it is not weighed further, or an empty sentence."""
        logs = {name: self._log_evidence(name, "laplace") for name in self.names}
        logs = {name: value for name, value in logs.items() if math.isfinite(value)}
        best = max(logs.values(), default=math.nan)
        found = {}
        for name in self.names:
            earlier = self._outcome(name, "laplace")
            if status_of(earlier) is Status.PRUNED:
                found[name] = earlier
            elif self.limit is not None and name in logs and best - logs[name] > self.limit:
                found[name] = Status.PRUNED.because(
                    f"log Bayes factor to the best below −{self.limit:g} by Laplace's approximation"
                )
            else:
                found[name] = ""
        return found

    def best_of(self) -> tuple[str, ...]:
        """The candidates whose posterior is sampled, the best first; all where the study sets no number.

        Beside the best they are those not far behind whose evidence is not to be trusted: bridge sampling and the
        referee start from draws.
        """
        count = self.study.posterior.best
        if count is None:
            return self.names
        found = self._heights()
        order, top = tuple(found), max(found.values(), default=math.nan)
        return (*order[:count], *(n for n in order[count:] if top - found[n] < FAR and self._is_doubtful(n)))

    def likely(self) -> tuple[str, ...]:
        """Those of which it is told what their evidence depends on: the sampled ones, and all that are not far
        behind."""
        found = self._heights()
        top = max(found.values(), default=math.nan)
        return tuple(
            dict.fromkeys([*self.best_of(), *(n for n, height in found.items() if top - height < FAR)])
        )

    def _heights(self) -> dict[str, float]:
        """The candidates that are left, the best first, with their log evidence."""
        order = [m for m in self.study.evidence.methods if m != "laplace"] + ["laplace"]

        def height(name: str) -> float:
            values = (self._log_evidence(name, method) for method in order)
            return next((v for v in values if math.isfinite(v)), -math.inf)

        left = ((n, height(n)) for n, why in self.candidates_left().items() if not why)
        return dict(sorted(left, key=lambda item: -item[1]))

    def _is_doubtful(self, name: str) -> bool:
        """Whether a method that has an error was tried on a candidate and is not to be trusted."""
        said = [self._outcome(name, method) for method in self.study.evidence.methods if method != "laplace"]
        return any(status_of(one) not in (Status.OK, Status.NOT_SAMPLED, Status.PRUNED) for one in said)

    def _cell(self, name: str, method: str) -> CellResult | None:
        return self.store.find(f"evidence/{self.spec.name}/{self.repeat}/{name}/{method}")

    def _outcome(self, name: str, method: str) -> str:
        cell = self._cell(name, method)
        return OK if cell is None else cell.outcome

    def _log_evidence(self, name: str, method: str) -> float:
        content = EvidenceContent.maybe(self._cell(name, method))
        return content.evidence.log_evidence if content and content.evidence else math.nan


def set_aside(store: Store, cells: Mapping[str, str], why: str) -> None:
    """Store a sentence in the place of each of these cells, by name and key."""
    for name, key in cells.items():
        if not store.has(name, aside := digest(why, key)):
            store.write(CellResult(name, aside, outcome=why))
