"""The answer for one record, within seconds: candidates fitted, weighed and put into numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from threadpoolctl import threadpool_limits

from bayesdamp.inference.deviation.candidate import Candidate
from bayesdamp.inference.deviation.data import prepared
from bayesdamp.inference.deviation.weighing import Known, Weighing, weigh_all
from bayesdamp.inference.model.defaults import Reference
from bayesdamp.physics.damping import all_sums, parse_model
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import Prior
from bayesdamp.types import Signal


def weighing_of(
    signal: Signal,
    *,
    damping: Sequence[str] = (),
    restoring: Sequence[str] = (),
    known: Known | None = None,
    priors: Mapping[str, Prior] | None = None,
    reference: Reference | None = None,
    approximate: bool = True,
) -> Weighing:
    """Weigh damping sums under restoring laws; all of both by default, for a record in metres the laws that translate.

    Raises Refusal where the record shows no oscillation, or no motion stays in phase with it.
    """
    laws = list(restoring) or [n for n in LAWS.names() if signal.unit == "rad" or LAWS.get(n).translates]
    sums = list(damping) or all_sums()
    candidates = [Candidate(parse_model(s), law) for law in laws for s in sums]
    # Matrices of a few dozen rows: threads of a linear algebra library only wait for each other.
    with threadpool_limits(1, "blas"):
        return weigh_all(
            prepared(signal),
            candidates,
            known=known,
            priors=priors,
            reference=reference,
            approximate=approximate,
        )
