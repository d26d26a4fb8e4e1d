"""Where searches and chains started, and where they ended."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.html import folded, stack
from bayesdamp.report.results.reading import mode_of, models_by_rank
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import SignalSection
from bayesdamp.store.contents import Climb, ModeContent, PosteriorContent
from bayesdamp.table import Table
from bayesdamp.types import OK, ChainStart, Seed

SHOWN = 4
"""Candidates that are shown at once; the others unfold."""
ALIKE = 0.1
"""Posterior sds within which the means of chains are called the same; R̂ judges in the table of the posterior."""


class Seeds(SignalSection):
    """Each seed's climb, the modes found, and what each chain made of its start."""

    order = 57
    title = "Where the searches started, and where they ended"
    lead = (
        "An optimisation (Levenberg–Marquardt) starts at every estimate, at each of its stages, and at a few draws "
        "from the prior. Chains start there too, scattered by more than the posterior's width; a starting point that "
        "is too far off for a chain is moved towards the mode until it is not."
    )

    def shows(self, run: Run, signal: str) -> bool:
        """Return whether modes were searched for."""
        return any(c.outcome == OK and ModeContent.of(c).climbs for c in run.cells("mode", signal))

    def part(self, run: Run, signal: str) -> Markup:
        """Return searches and chains, candidate by candidate, the likeliest open."""
        repeat = run.repeats(signal)[0]
        parts: list[Markup] = []
        for model in models_by_rank(run, signal, repeat):
            mode = mode_of(run, signal, repeat, model)
            if mode is None or not mode.climbs:
                continue
            name = words.model(model)
            summary = Markup("<p><strong>{}.</strong> {}</p>").format(
                name[:1].upper() + name[1:], " ".join(_sentences(mode))
            )
            tables = [_table(mode), *_chains(run, signal, repeat, model)]
            parts.append(stack(summary, folded(f"Starting points and chains of {name}", *tables)))
        more = parts[SHOWN:]
        return stack(*parts[:SHOWN], folded(f"{len(more)} more models", *more) if more else "")


def _sentences(mode: ModeContent) -> list[str]:
    climbs, modes = mode.climbs, mode.modes
    ended = [c for c in climbs if c.mode == 0]
    reached = sum(1 + len(c.same) for c in ended)
    every = "All " if len(ended) == len(climbs) and reached != 1 else ""
    found = [f"{every}{reached} starting point{'s' if reached != 1 else ''} reached the mode."]
    elsewhere = [c for c in climbs if c.mode]
    if elsewhere:
        best = modes[1] if len(modes) > 1 else None
        depth = mode.log_posterior - best.log_posterior if best else math.nan
        share = f", about {100 * best.share:.2g} % of the posterior" if best and best.share > 1e-3 else ""
        found.append(
            f"{_names(elsewhere)} ended in another maximum; the highest of these is {fmt.number(depth, 3)} "
            f"nats lower{share}, and was not sampled."
        )
    failed = [c for c in climbs if c.mode is None]
    if failed:
        found.append(f"{_names(failed)} came to no maximum.")
    if mode.refused:
        found.append(f"No values to start from: {fmt.listing(_name(r.seed) for r in mode.refused)}.")
    touching = [words.symbol(n).text for n in mode.touching_zero]
    if touching:
        found.append(f"The posterior of {fmt.listing(touching)} touches zero.")
    return found


def _name(seed: Seed) -> str:
    more = [words.stage(seed.stage)] if seed.stage else []
    more += ["over growing windows"] if seed.grown else []
    return words.method(seed.source) + (f" ({', '.join(more)})" if more else "")


def _names(climbs: Sequence[Climb]) -> str:
    listed = [_name(n) for c in climbs for n in (c.seed, *c.same)]
    text = fmt.listing(listed)
    return text[:1].upper() + text[1:]


def _table(mode: ModeContent) -> Table:
    def below(value: float | None) -> str:
        """Return by how many nats a log posterior is below the mode's."""
        if value is None or not math.isfinite(value):
            return "not finite"
        return fmt.number(mode.log_posterior - value, 3)

    def ended(c: Climb) -> str:
        return "no maximum" if c.mode is None else f"maximum {c.mode + 1}" if c.mode else "the mode"

    columns: dict[str, Callable[[Climb], str]] = {
        "starting point": lambda c: fmt.listing(_name(n) for n in (c.seed, *c.same)),
        "start: nats below": lambda c: below(c.start),
        "sds from the mode": lambda c: fmt.number(c.distance, 3),
        "likelihoods": lambda c: str(c.evaluations),
        "ended in": ended,
        "end: nats below": lambda c: fmt.nats(max(mode.log_posterior - c.end, 0.0)),
    }
    return Table.of(
        mode.climbs, columns, (0, 4), kind=lambda c: "alert" if c.mode is None else "quiet" if c.mode else ""
    )


def _chains(run: Run, signal: str, repeat: int, model: str) -> list[Table]:
    columns: dict[str, Callable[[tuple[int, ChainStart]], str]] = {
        "chain": lambda s: str(s[0]),
        "starting point": lambda s: _name(s[1].seed),
        "sds from the mode": lambda s: fmt.number(s[1].seed_distance, 3),
        "start moved to": lambda s: fmt.number(s[1].distance, 2),
        "mean off that of all / sd": lambda s: fmt.fixed(s[1].shift, 2),
    }
    found = {
        c.place.method: PosteriorContent.of(c).posterior.starts
        for c in run.cells("posterior", signal, repeat, model)
    }
    return [
        Table.of(
            enumerate(starts, 1),
            columns,
            (0, 1),
            f"Chains of {words.method(sampler)}",
            lambda s: "alert" if s[1].shift > ALIKE else "",
        )
        for sampler, starts in found.items()
        if starts
    ]


PLUGIN = Seeds()
