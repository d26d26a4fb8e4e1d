"""The answer for one record, within seconds: candidates fitted, weighed and put into numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

from threadpoolctl import threadpool_limits

from bayesdamp.inference.deviation.candidate import Candidate
from bayesdamp.inference.deviation.data import Data, prepared
from bayesdamp.inference.deviation.numbers.averaging import averaging_of, set_right
from bayesdamp.inference.deviation.numbers.exponent import exponents_of
from bayesdamp.inference.deviation.numbers.rivals import with_rivals
from bayesdamp.inference.deviation.sample_noise import AUTOMATIC, MOST_CYCLES, prepared_for
from bayesdamp.inference.deviation.weighing import START, Known, Weighing, weigh_all
from bayesdamp.physics.damping import all_sums, parse_model
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import Prior
from bayesdamp.types import Reference, Signal


def weighing_of(
    signal: Signal,
    *,
    damping: Sequence[str] = (),
    restoring: Sequence[str] = (),
    known: Known | None = None,
    priors: Mapping[str, Prior] | None = None,
    reference: Reference | None = None,
    approximate: bool = True,
    noises: Sequence[str] = AUTOMATIC,
) -> Weighing:
    """Weigh damping sums under restoring laws; all of both by default, for a record in metres the laws that translate.

    Of a record of hundreds of cycles amplitudes and phases are weighed, where that moves no parameter by more than a
    tenth of its sd, or the record has more cycles than the ODE is solved for. noises: noise models, of which the
    likeliest is used.

    Raises Refusal where the record shows no oscillation, or no motion stays in phase with it.
    """
    laws = list(restoring) or [n for n in LAWS.names() if signal.unit == "rad" or LAWS.get(n).translates]
    sums = list(damping) or all_sums()
    candidates = [Candidate(parse_model(s), law) for law in laws for s in sums]
    # Matrices of a few dozen rows: threads of a linear algebra library only wait for each other.
    with threadpool_limits(1, "blas"):
        of = partial(
            weigh_all, candidates=candidates, known=known, priors=priors, reference=reference, approximate=approximate,
            noises=noises,
        )  # fmt: skip
        # To a start that is given the averaged motion's phase is no more than near.
        under = [known(law) if callable(known) else known or {} for law in laws]
        start_known = any(name in one for one in under for name in START)
        data = prepared_for(signal, noises, under[0], priors or {}, average=not start_known)
        weighing = _weighed(of, data, signal, approximate)
        weighing = with_rivals(weighing, approximate)
        return replace(weighing, exponents=exponents_of(weighing, approximate))


def _weighed(of: Callable[[Data], Weighing], data: Data, signal: Signal, approximate: bool) -> Weighing:
    """Candidates weighed on averages where these are close to the ODE, else on samples."""
    weighing = of(data)
    if data.averaged is None or not weighing.results:
        return weighing
    weighing = set_right(weighing, approximate)
    averaging = averaging_of(weighing)
    if averaging is None:
        return weighing
    if averaging.close or data.cycles > MOST_CYCLES:
        return replace(weighing, averaging=averaging)
    return of(prepared(signal, average=False))
