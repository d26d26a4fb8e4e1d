"""The starting points of searches and chains, and where they ended."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.markup import folded, stack
from bayesdamp.report.results.reading import mode_of, models_by_rank
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.sections import SignalSection
from bayesdamp.store.contents import Climb, ModeContent, PosteriorContent
from bayesdamp.table import Table
from bayesdamp.types import OK, ChainStart, Seed

SHOWN = 4
"""Number of candidates that are shown without unfolding them."""
ALIKE = 0.1
"""Posterior sds within which the means of chains agree; R̂ decides in the table of the posterior."""


class SeedsSection(SignalSection):
    """The search from each starting point, the modes, and the chains from each start."""

    order = 57
    title = "Starting points of the searches and chains"
    lead = (
        "An optimisation (Levenberg–Marquardt) starts at every estimate, at each of its stages, and at a few draws "
        "from the prior. Chains start there too, with a scatter that is larger than the posterior's width. A starting "
        "point that is too far away for a chain is moved towards the mode."
    )

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether modes were searched for."""
        return any(c.outcome == OK and ModeContent.of(c).climbs for c in run.cells("mode", signal))

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return searches and chains of each candidate, the most probable open."""
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
            tables = [_searches(mode), *_chains(run, signal, repeat, model)]
            parts.append(stack(summary, folded(f"Starting points and chains of {name}", *tables)))
        more = parts[SHOWN:]
        return stack(*parts[:SHOWN], folded(f"{len(more)} more models", *more) if more else "")


def _sentences(mode: ModeContent) -> list[str]:
    climbs, modes = mode.climbs, mode.modes
    ended = [c for c in climbs if c.mode == 0]
    reached = sum(1 + len(c.same) for c in ended)
    every = "All " if len(ended) == len(climbs) and reached != 1 else ""
    sentences = [f"{every}{reached} starting point{'s' if reached != 1 else ''} reached the mode."]
    elsewhere = [c for c in climbs if c.mode]
    if elsewhere:
        best = modes[1] if len(modes) > 1 else None
        depth = mode.log_posterior - best.log_posterior if best else math.nan
        share = (
            f", has about {100 * best.share:.2g} % of the posterior," if best and best.share > 1e-3 else ""
        )
        sentences.append(
            f"{_names(elsewhere)} ended in another maximum; the highest of these is {fmt.number(depth, 3)} "
            f"nats lower{share} and was not sampled."
        )
    failed = [c for c in climbs if c.mode is None]
    if failed:
        sentences.append(f"{_names(failed)} did not reach a maximum.")
    if mode.refused:
        sentences.append(f"Estimates without usable values: {_listing(r.seed for r in mode.refused)}.")
    touching = [words.symbol(n).text for n in mode.touching_zero]
    if touching:
        sentences.append(f"The posterior of {fmt.listing(touching)} touches zero.")
    return sentences


def _listing(seeds: Iterable[Seed]) -> str:
    """List starting points by their source and stage."""
    names = []
    for seed in seeds:
        details = [words.stage(seed.stage)] if seed.stage else []
        details += ["over growing windows"] if seed.grown else []
        names.append(words.method(seed.source) + (f" ({', '.join(details)})" if details else ""))
    return fmt.listing(names)


def _names(climbs: Sequence[Climb]) -> str:
    """List the starting points of searches at the beginning of a sentence."""
    text = _listing(seed for c in climbs for seed in (c.seed, *c.same))
    return text[:1].upper() + text[1:]


def _searches(mode: ModeContent) -> Table:
    def below(value: float | None) -> str:
        """Return by how many nats a log posterior is below the mode's."""
        if value is None or not math.isfinite(value):
            return "not finite"
        return fmt.number(mode.log_posterior - value, 3)

    def ended(c: Climb) -> str:
        return "no maximum" if c.mode is None else f"maximum {c.mode + 1}" if c.mode else "the mode"

    def kind(c: Climb) -> str:
        return "alert" if c.mode is None else "quiet" if c.mode else ""

    columns: dict[str, Callable[[Climb], str]] = {
        "starting point": lambda c: _listing((c.seed, *c.same)),
        "start: nats below the mode": lambda c: below(c.start),
        "sds from the mode": lambda c: fmt.number(c.distance, 3),
        "likelihood evaluations": lambda c: str(c.evaluations),
        "ended in": ended,
        "end: nats below the mode": lambda c: fmt.nats(max(mode.log_posterior - c.end, 0.0)),
    }
    return Table.of(mode.climbs, columns, (0, 4), kind=kind)


def _chains(run: RunFolder, signal: str, repeat: int, model: str) -> list[Table]:
    def kind(s: tuple[int, ChainStart]) -> str:
        return "alert" if s[1].shift > ALIKE else ""

    columns: dict[str, Callable[[tuple[int, ChainStart]], str]] = {
        "chain": lambda s: str(s[0]),
        "starting point": lambda s: _listing([s[1].seed]),
        "sds from the mode": lambda s: fmt.number(s[1].seed_distance, 3),
        "sds after moving it": lambda s: fmt.number(s[1].distance, 2),
        "difference of its mean from that of all chains / sd": lambda s: fmt.fixed(s[1].shift, 2),
    }
    tables = []
    for cell in run.cells("posterior", signal, repeat, model):
        starts = PosteriorContent.of(cell).posterior.starts
        if starts:
            caption = f"Chains of {words.method(cell.place.method)}"
            tables.append(Table.of(enumerate(starts, 1), columns, (0, 1), caption, kind))
    return tables


PLUGIN = SeedsSection()
