"""Which damping sums envelopes are weighed under: the paper's, or those of any registered terms that were asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bayesdamp.physics.amplitude.laws import POWERS, SUMS
from bayesdamp.plugins import PluginModule, read_modules, use
from bayesdamp.records.envelope.record import EnvelopeRecord
from bayesdamp.types import InputError

LONGEST = 3
"""Terms of a sum: what a decay tells apart."""


@dataclass(frozen=True)
class Asked:
    """sums: by their terms' names; plugins: modules of a user's own terms; left_out: sentences on sums that lose as one
    of these does at every amplitude."""

    sums: tuple[tuple[str, ...], ...] = SUMS
    plugins: tuple[PluginModule, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def registered(self) -> tuple[str, ...]:
        """Terms beside viscous, Coulomb and quadratic damping."""
        return tuple(dict.fromkeys(t for terms in self.sums for t in terms if t not in POWERS))

    def of(self, record: EnvelopeRecord) -> None:
        """Raises InputError where a term cannot be weighed on this record."""
        if self.registered:
            from bayesdamp.records.envelope.scale import scale_of

            scale_of(record, self.sums, 0.0)

    def sources(self) -> tuple[str, ...]:
        """Digests of the code of the terms, which the process has to have."""
        if not self.registered:
            return ()
        from bayesdamp.physics.damping import TERMS

        return tuple(TERMS.source(name) for name in self.registered)

    def settings(self) -> tuple[str, ...]:
        """What is said of it on a page, a sentence each; () of the paper's sums."""
        if not self.registered and self.sums == SUMS:
            return ()
        from bayesdamp.physics.damping import TERMS

        said = [f"Weighed were {', '.join(map('+'.join, self.sums))}.", *self.left_out]
        inferred = [one for name in self.registered for one in TERMS.get(name).inferred]
        if inferred:
            each = ", ".join(f"{one.name} {one.prior(1.0, 1.0).describe()}" for one in inferred)
            said.append(
                f"Parameters of terms have the terms' own priors, here in units of the amplitude at the start and the "
                f"angular frequency: {each}."
            )
        return tuple(said)


def asked(damping: Sequence[str] = (), plugins: Sequence[str] = ()) -> Asked:
    """What options ask for: sums such as `viscous+cubic` in place of the paper's; files of a user's own terms, which
    are weighed alone and beside each of the paper's where no sums are given.

    Raises InputError.
    """
    modules = read_modules(plugins)
    use(modules)
    if not damping and not modules:
        return Asked()
    from bayesdamp.physics.damping import PAPER_TERMS, TERMS, parse_model

    sums = [parse_model(name) for name in damping]
    for name in () if damping else TERMS.added():
        sums += [(name,), *((other, name) for other in PAPER_TERMS)]
    for terms in sums:
        if len(terms) > LONGEST:
            raise InputError(
                f"--damping {'+'.join(terms)}: an envelope is weighed under sums of {LONGEST} terms at most; "
                "leave one out"
            )
    return _told_apart(sums if damping else [*SUMS, *sums], modules, bool(damping))


def _told_apart(sums: Sequence[tuple[str, ...]], modules: tuple[PluginModule, ...], strict: bool) -> Asked:
    """Without sums that lose as an earlier one does. strict: raises InputError where two terms of a sum lose alike."""
    from bayesdamp.physics.amplitude.loss import alike, log_loss
    from bayesdamp.physics.damping import TERMS

    terms = list(dict.fromkeys([*POWERS, *(t for one in sums for t in one)]))
    for name in terms:
        if not TERMS.get(name).inferred:
            log_loss(TERMS.get(name))
    first = {t: next(u for u in terms if u == t or alike(TERMS.get(u), TERMS.get(t))) for t in terms}
    kept: dict[frozenset[str], tuple[str, ...]] = {}
    said = []
    for one in dict.fromkeys(sums):
        means = frozenset(first[t] for t in one)
        name = "+".join(one)
        if len(means) < len(one):
            twins = " and ".join(t for t in one if sum(first[u] == first[t] for u in one) > 1)
            if strict:
                raise InputError(
                    f"--damping {name}: {twins} lose alike at every amplitude, no envelope tells them apart; "
                    "leave one of them out"
                )
        elif means in kept:
            said.append(
                f"{name} is not weighed: it loses as {'+'.join(kept[means])} does at every amplitude."
            )
        else:
            kept[means] = one
    # Terms in one order, so that a sum has one name.
    return Asked(tuple(tuple(sorted(one, key=terms.index)) for one in kept.values()), modules, tuple(said))
