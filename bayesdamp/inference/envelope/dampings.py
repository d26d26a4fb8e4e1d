"""Which damping sums an envelope can be weighed under, and what is assumed of them."""

from __future__ import annotations

from collections.abc import Sequence

from bayesdamp.inference.deviation.gaussian.hyperparameters import EXACT, MEAN_G
from bayesdamp.inference.envelope.posterior import DRIFT, SENSOR
from bayesdamp.odds import FURTHER_TERM
from bayesdamp.physics.amplitude.laws import POWERS, SUMS
from bayesdamp.physics.damping import TERMS
from bayesdamp.priors import SHARED_SCALES
from bayesdamp.records.envelope.decay import ABOVE_FLOOR
from bayesdamp.types import InputError

LONGEST = 3
"""Terms of a sum: a decay cannot distinguish more."""
ASSUMED = (
    "Each term's equivalent damping ratio at the amplitude in the middle of the fall in dB has a half-normal prior. "
    "Its scale is the same for all terms of a sum and unknown: all orders of magnitude between "
    f"{SHARED_SCALES[0]:g} and {SHARED_SCALES[-1]:g} are equally probable. Where the frequency is not known, the "
    "rates have the same prior, with scales of which the middle one is one over the duration of the decay.",
    f"Prior odds of a sum: 1 for a single term, times {FURTHER_TERM:g} for each further term.",
    f"The law holds exactly with probability {EXACT:g}, else its rate is multiplied by 1 + g, g of sd τ, exponential "
    f"with mean {MEAN_G:g}.",
    f"Every rate is known to {100 * SENSOR:g} % (sd) at best (detector, clock); where readings are in dB, also to "
    f"{DRIFT:g} dB of drift or bend of the detector over half of the decay.",
    f"Readings count down to {ABOVE_FLOOR:g} dB above the noise floor. Q and the rate at the head are the law's, mean "
    "over the first half of the fall in dB; those at three amplitudes are as they were, with the deviation.",
)
Sums = tuple[tuple[str, ...], ...]


def further_terms(sums: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """Return the terms other than viscous, Coulomb and quadratic damping."""
    return tuple(dict.fromkeys(t for terms in sums for t in terms if t not in POWERS))


def assumed(sums: Sequence[tuple[str, ...]], left_out: Sequence[str] = ()) -> tuple[str, ...]:
    """Return what an answer under these sums assumes, a sentence each."""
    own: list[str] = [] if tuple(sums) == SUMS else [f"Weighed were {', '.join(map('+'.join, sums))}."]
    inferred = [one for name in further_terms(sums) for one in TERMS.get(name).inferred]
    each = ", ".join(f"{one.name} {one.prior(1.0, 1.0).describe()}" for one in inferred)
    if inferred:
        own.append(
            "Parameters of terms have the terms' own priors, here in units of the amplitude at the start and the "
            f"angular frequency: {each}."
        )
    return (*own[:1], *left_out, *own[1:], *ASSUMED)


def weighable(sums: Sequence[tuple[str, ...]]) -> tuple[Sums, tuple[str, ...]]:
    """Return the sums that an envelope can distinguish, and a sentence on each that is left out.

    Two terms have the same envelope where they lose the same at every amplitude.

    Raises
    ------
    InputError
        Where a sum is too long, or no sum is left.
    """
    if set(sums) == set(SUMS):
        return SUMS, ()
    from bayesdamp.physics.amplitude.loss import alike, log_loss

    for one in sums:
        if len(one) > LONGEST:
            raise InputError(
                f"damping {'+'.join(one)}: an envelope is weighed under sums of {LONGEST} terms at most; leave one out"
            )
    terms = list(dict.fromkeys([*POWERS, *(t for one in sums for t in one)]))
    for name in terms:
        if not TERMS.get(name).inferred:
            log_loss(TERMS.get(name))
    first = {t: next(u for u in terms if u == t or alike(TERMS.get(u), TERMS.get(t))) for t in terms}
    weighed: dict[frozenset[str], tuple[str, ...]] = {}
    left_out = []
    for one in dict.fromkeys(sums):
        means, name = frozenset(first[t] for t in one), "+".join(one)
        if len(means) < len(one):
            twins = " and ".join(t for t in one if sum(first[u] == first[t] for u in one) > 1)
            left_out.append(f"{name} is not weighed: {twins} lose alike at every amplitude.")
        elif means in weighed:
            same = "+".join(weighed[means])
            left_out.append(f"{name} is not weighed: it loses as {same} does at every amplitude.")
        else:
            weighed[means] = one
    if not weighed:
        raise InputError(f"damping {left_out[0]} Name other sums")
    return tuple(weighed.values()), tuple(left_out)
