"""The records of one specimen, as a run holds them, and a candidate on all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from functools import cached_property

import numpy as np

from bayesdamp.config import SignalSpec, Study
from bayesdamp.inference.curves.weighted import shares, summarise
from bayesdamp.inference.many.joint import (
    Joint,
    JointMode,
    damping_parameters,
    find_joint_mode,
    law_parameters,
)
from bayesdamp.inference.many.joint_evidence import Weighed
from bayesdamp.inference.many.record import Exact, Record
from bayesdamp.inference.model.defaults import Reference
from bayesdamp.outcomes import Status, following
from bayesdamp.physics.units import parameter_unit
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.candidates.cells import cells_of
from bayesdamp.pipeline.many.laws import answered_logs, joined_on
from bayesdamp.pipeline.pruning import looked
from bayesdamp.pipeline.records.answering import approximately
from bayesdamp.pipeline.records.records import cell_seed
from bayesdamp.store import Store
from bayesdamp.store.contents.candidates import ModeContent
from bayesdamp.store.contents.many import WeighedContent, Weighing
from bayesdamp.store.contents.records import RecordContent
from bayesdamp.types import OK, Refusal, candidate_parts

BOTH, DAMPING, LAW, NOTHING = "damping and law", "damping", "law", "nothing"
"""What the records of a specimen may share."""


@dataclass(frozen=True)
class Problem:
    """One candidate on the records of a specimen, and values at each record's own mode."""

    records: tuple[Record, ...]
    starts: tuple[Mapping[str, float], ...]

    def names(self, sharing: str) -> tuple[str, ...]:
        """The parameters that are shared under a sharing."""
        damping = damping_parameters(self.records[0]) if sharing in (BOTH, DAMPING) else ()
        law = (
            dict.fromkeys(n for r in self.records for n in law_parameters(r))
            if sharing in (BOTH, LAW)
            else ()
        )
        return (*damping, *law)

    def mode(self, shared: tuple[str, ...]) -> JointMode:
        """The joint mode. Raises Refusal."""
        return find_joint_mode(Joint(self.records, shared), self.starts)

    def alone(self, record: int) -> JointMode:
        """One record's own mode, as a joint one with all its parameters shared. Raises Refusal."""
        own = (self.records[record],)
        return find_joint_mode(Joint(own, own[0].live), [self.starts[record]])


class Specimen:
    """The records of one specimen, as the store holds them.

    Their priors are those of one reference, the geometric mean of their own ones; a friction's ε that was not given
    follows from it too.
    """

    def __init__(self, study: Study, name: str, specs: Sequence[SignalSpec], store: Store) -> None:
        self.study, self.name, self.specs, self.store = study, name, tuple(specs), store
        self.records = [(spec, repeat) for spec in self.specs for repeat in range(spec.repeats)]
        self.labels = [f"{s.name}, {r + 1}" if s.repeats > 1 else s.name for s, r in self.records]
        self.candidates = study.compare(self.specs[0])

    def branches(self, candidate: str) -> list[Branch]:
        """A candidate's branch on each record."""
        return [Branch(self.study, spec, repeat, candidate, self.store) for spec, repeat in self.records]

    @cached_property
    def reference(self) -> Reference:
        """The reference of all records' priors. Raises Refusal where a record has none."""
        cells = [self.store.read(f"signal/{spec.name}/{repeat}") for spec, repeat in self.records]
        for label, cell in zip(self.labels, cells, strict=True):
            if cell.outcome != OK:
                raise Refusal(f"{label}: {following(cell.name, cell.outcome)}")
        scales = [RecordContent.of(cell).scales for cell in cells]
        amplitude, frequency = (
            float(np.exp(np.mean(np.log(one)))) for one in zip(*map(astuple, scales), strict=True)
        )
        return Reference(amplitude, frequency)

    @property
    def approximate(self) -> bool:
        """Whether laws may hold approximately: where they may in every record's answer."""
        return all(approximately(self.study, spec) for spec in self.specs)

    @property
    def deviation(self) -> str:
        """What results say of it: "law" or "none"."""
        return "law" if self.approximate else "none"

    def problem(self, candidate: str) -> Problem:
        """A candidate on all records. Raises Refusal where it was not fitted to one of them."""
        branches = self.branches(candidate)
        if self.approximate:
            records, starts = joined_on(branches, self.labels, self.reference)
        else:
            records, starts = self._exact(branches)
        return Problem(tuple(records), tuple(starts))

    def _exact(self, branches: Sequence[Branch]) -> tuple[list[Record], list[Mapping[str, float]]]:
        """The records under laws that hold exactly, with values at their modes."""
        starts, tolerances = [], []
        for label, branch in zip(self.labels, branches, strict=True):
            name = f"mode/{branch.path}"
            try:
                cell = self.store.read(name)
                if cell.key != cells_of(branch)[name]:
                    raise KeyError(name)  # of an earlier question in the same folder
            except KeyError:
                raise Refusal(
                    Status.PRUNED.because(f"not fitted to {label}, where its law is far behind")
                ) from None
            if cell.outcome != OK:
                raise Refusal(f"{label}: {following(cell.name, cell.outcome)}")
            mode = ModeContent.of(cell)
            starts.append(mode.values)
            tolerances.append(mode.tolerance)
        epsilon = shared_epsilon(branches)
        records: list[Record] = [
            Exact(
                branch.record.target(
                    branch.terms,
                    branch.restoring,
                    branch.noise,
                    beside=branch.beside,
                    reference=self.reference,
                    epsilon=epsilon,
                ),
                tolerance,
            )
            for branch, tolerance in zip(branches, tolerances, strict=True)
        ]
        return records, starts

    def alone(self, candidates: Sequence[str]) -> list[dict[str, float]]:
        """Of each record the log evidence of the candidates that have one there, by a first look."""
        if self.approximate:
            return [answered_logs(each) for each in zip(*map(self.branches, candidates), strict=True)]
        return [looked(self.study, spec, r, self.store, tuple(candidates)) for spec, r in self.records]

    def seed(self, *what: str) -> int:
        """Of what is drawn for this specimen."""
        return cell_seed(self.study, "/".join(("joint", self.name, *what)))

    def units(self, candidate: str, names: Sequence[str]) -> dict[str, str]:
        """Units of parameters, as tables have them."""
        law = candidate_parts(candidate)[1] or self.specs[0].restoring[0]
        signal = self.branches(candidate)[0].record.signal
        return {n: parameter_unit(n, law, signal.unit, signal.quantity) for n in names}


def shared_epsilon(branches: Sequence[Branch]) -> float | None:
    """The friction's ε (rad/s) of all records, the geometric mean, where one asks for another than the usual."""
    if all(b.epsilon is None for b in branches):
        return None
    return float(np.exp(np.mean([np.log(b.epsilon or b.system.known["epsilon"]) for b in branches])))


def weighing(
    found: Weighed, summary: Mapping[str, Mapping[str, float]], units: Mapping[str, str] | None = None
) -> Weighing:
    """What a cell holds of a candidate's evidence and parameters."""
    return Weighing(**weighed_content(found).meta(), summary=summary, units=units or {})


def weighed_content(found: Weighed) -> WeighedContent:
    """What a cell holds of an evidence alone."""
    return WeighedContent(**{f.name: getattr(found, f.name) for f in fields(WeighedContent)})


def summaries(mode: JointMode, found: Weighed) -> dict[str, dict[str, float]]:
    """Summary of each shared parameter."""
    w = shares(found.log_weights)
    return {n: summarise(v, w) for n, v in mode.joint.values(found.scores).items()}


def draws_of(label: str, mode: JointMode, found: Weighed) -> dict[str, np.ndarray]:
    """Weighted draws of the damping coefficients, with the log density of their prior, as arrays of a cell."""
    values, priors = mode.joint.values(found.scores), mode.joint.records[0].priors
    coefficients = [n for n in mode.joint.records[0].oscillator.coefficients if n in values]
    arrays = {f"{label}/{n}": values[n] for n in coefficients}
    arrays |= {f"{label}/{n}/log_prior": np.asarray(priors[n].log_density(values[n])) for n in coefficients}
    return arrays | {f"{label}/log_weights": found.log_weights}
