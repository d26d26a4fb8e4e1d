"""Which damping sums an envelope can distinguish, and the assumptions behind an answer."""

from __future__ import annotations

from collections.abc import Sequence

from bayesdamp.inference.deviation.gaussian.hyperparameters import EXACT, MEAN_G
from bayesdamp.inference.envelope.posterior import DRIFT, SENSOR
from bayesdamp.odds import FURTHER_TERM
from bayesdamp.physics.amplitude.laws import POWERS, SUMS
from bayesdamp.physics.damping import TERMS
from bayesdamp.priors import SHARED_SCALES
from bayesdamp.records.envelope.floor import ABOVE_FLOOR
from bayesdamp.types import InputError

LONGEST = 3
"""Largest number of terms in a sum: a decay cannot distinguish more."""
ASSUMED = (
    "Each term's equivalent damping ratio at the amplitude in the middle of the fall in dB has a half-normal prior. "
    "Its scale is unknown and the same for all terms of a sum: all orders of magnitude between "
    f"{SHARED_SCALES[0]:g} and {SHARED_SCALES[-1]:g} are equally probable. Where the frequency is not known, the "
    "rates have the same prior, with the middle of its scales at one over the duration of the decay.",
    f"Prior odds of a sum: 1 for a single term, times {FURTHER_TERM:g} for each further term.",
    f"The law holds exactly with probability {EXACT:g}. Otherwise its rate is multiplied by 1 + g, where g has the sd "
    f"τ, which has an exponential prior with mean {MEAN_G:g}.",
    f"Every rate is known to {100 * SENSOR:g} % (sd) at best (detector, clock). Readings in dB may also contain "
    f"{DRIFT:g} dB of drift or nonlinearity of the detector over half of the decay.",
    f"Readings down to {ABOVE_FLOOR:g} dB above the noise floor are used. The quoted Q and rate are those of the law, "
    "averaged over the first half of the fall in dB; the values at three amplitudes include the deviation.",
)
Sums = tuple[tuple[str, ...], ...]


def further_terms(sums: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """Return the terms other than viscous, Coulomb and quadratic damping."""
    return tuple(dict.fromkeys(t for terms in sums for t in terms if t not in POWERS))


def assumed(sums: Sequence[tuple[str, ...]], left_out: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the assumptions of an answer under these sums, a sentence each.

    Parameters
    ----------
    sums : sequence of tuple of str
        Terms of each sum.
    left_out : sequence of str
        Sentences on sums that are left out.
    """
    weighed = () if tuple(sums) == SUMS else (f"The sums are {', '.join(map('+'.join, sums))}.",)
    inferred = [p for name in further_terms(sums) for p in TERMS.get(name).inferred]
    each = ", ".join(f"{p.name} {p.prior(1.0, 1.0).describe()}" for p in inferred)
    further = (
        "Further parameters of terms have the terms' own priors, here in units of the amplitude at the start and the "
        f"angular frequency: {each}.",
    )
    return (*weighed, *left_out, *(further if inferred else ()), *ASSUMED)


def weighable(sums: Sequence[tuple[str, ...]]) -> tuple[Sums, tuple[str, ...]]:
    """Return the sums that an envelope can distinguish, and a sentence on each sum that is left out.

    Two terms have the same envelope if they lose the same at every amplitude.

    Raises
    ------
    InputError
        Where a sum is too long, or no sum is left.
    """
    if set(sums) == set(SUMS):
        return SUMS, ()
    from bayesdamp.physics.amplitude.loss import alike, log_loss

    for asked in sums:
        if len(asked) > LONGEST:
            raise InputError(
                f"damping {'+'.join(asked)}: a sum for an envelope has at most {LONGEST} terms; leave one out"
            )
    terms = list(dict.fromkeys([*POWERS, *(t for asked in sums for t in asked)]))
    for name in terms:
        if not TERMS.get(name).inferred:
            log_loss(TERMS.get(name))
    first = {t: next(u for u in terms if u == t or alike(TERMS.get(u), TERMS.get(t))) for t in terms}
    weighed: dict[frozenset[str], tuple[str, ...]] = {}
    left_out = []
    for asked in dict.fromkeys(sums):
        distinct, name = frozenset(first[t] for t in asked), "+".join(asked)
        if len(distinct) < len(asked):
            twins = " and ".join(t for t in asked if sum(first[u] == first[t] for u in asked) > 1)
            left_out.append(f"{name} is left out: {twins} lose the same at every amplitude.")
        elif distinct in weighed:
            same = "+".join(weighed[distinct])
            left_out.append(f"{name} is left out: it loses the same as {same} at every amplitude.")
        else:
            weighed[distinct] = asked
    if not weighed:
        raise InputError(f"damping {left_out[0]} Name other sums")
    return tuple(weighed.values()), tuple(left_out)
