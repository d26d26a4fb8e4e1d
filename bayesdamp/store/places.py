"""What a task is about, which its name in a run's folder says: here alone it is read from one."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Place:
    """The parts of a name such as `estimate/bench/0/viscous/least_squares`; what it has not is empty, or None.

    kind: of task. record: whose it is, or the specimen's. repeat: of the record. candidate: the damping sum, with its
    law where several are compared, or the law of a fit that all dampings share. method: the estimator, the sampler, the
    way to evidence, or what is changed.
    """

    kind: str
    record: str = ""
    repeat: int | None = None
    candidate: str = ""
    method: str = ""

    @classmethod
    def of(cls, name: str) -> Place:
        """Of a task's name."""
        kind, *rest = name.split("/")
        record = rest.pop(0) if rest else ""
        repeat = int(rest.pop(0)) if rest and rest[0].isdigit() else None  # a specimen's have none
        candidate, method = (*rest, "", "")[:2]
        return cls(kind, record, repeat, candidate, method)
