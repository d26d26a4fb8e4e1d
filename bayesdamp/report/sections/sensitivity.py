"""What the evidence depends on: the priors' width and odds, half the record, a third check; and the models' average."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.odds import FURTHER_TERM
from bayesdamp.report import words
from bayesdamp.report.figures import evidence as figures
from bayesdamp.report.figures.curves import ratio
from bayesdamp.report.html import paragraph, stack
from bayesdamp.report.results.reading import mode_of, models_by_rank, over_odds, ranking
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import SignalSection
from bayesdamp.report.style import INK
from bayesdamp.store import CellResult
from bayesdamp.store.contents.evidence import HalfContent, NoisesContent, RatiosContent, WidthsContent
from bayesdamp.store.contents.posteriors import AverageContent
from bayesdamp.table import Line, Table
from bayesdamp.types import OK, Forecast

_ONE_NOISE = (
    'Other noise models are not computed under deviation = "law": what is coloured in the rest is taken by the '
    "deviations there, and by a variance of the noise that is larger near the oscillation."
)


_NO_WIDTH = "No damping prior has a width to vary here: the scale of the default prior is averaged over."


class Sensitivity(SignalSection):
    """Of a signal's first repeat: Bayes factors over prior widths, the first half, Savage and Dickey, the average."""

    order = 62
    name = "sensitivity"
    title = "What the evidence depends on"

    def shows(self, run: Run, signal: str) -> bool:
        """Return whether a signal was weighed under other assumptions too."""
        return any(cell.outcome == OK for cell in run.cells("sensitivity", signal))

    def part(self, run: Run, signal: str) -> Markup:
        """Return prior widths, odds, halves and other noise."""
        models = models_by_rank(run, signal, 0)
        views = (_widths, _odds, _elsewhere, _halves, _prediction, _ratios, _average)
        return stack(*(view(run, signal, models) for view in views))

    def render(self, run: Run) -> Markup:
        """Return the content on each signal, and why there is one noise model."""
        return stack(super().render(run), paragraph(_ONE_NOISE, "small") if run.under_law else "")


def _cells(run: Run, signal: str, models: list[str], kind: str) -> dict[str, CellResult]:
    found = {m: run.cell("sensitivity", signal, 0, m, kind) for m in models}
    return {m: c for m, c in found.items() if c is not None and c.outcome == OK}


def _widths(run: Run, signal: str, models: list[str]) -> Markup | None:
    cells = _cells(run, signal, models, "widths")
    if len(cells) < 2:
        return None
    if not any(WidthsContent.of(cell).varied for cell in cells.values()):
        return paragraph(_NO_WIDTH)
    best = next(iter(cells))
    reference = cells[best].arrays["log_evidence"]
    shown = {
        m: {**c.arrays, "log_bayes_factor": c.arrays["log_evidence"] - reference} for m, c in cells.items()
    }
    least = min(
        (float(c.arrays["effective"][~c.arrays["anew"]].min(initial=math.inf)) for c in cells.values()),
        default=math.inf,
    )
    caption = (
        f"{signal}: log Bayes factor to {words.model(best)} as the scales of all given damping priors are multiplied. "
        f"Dots: the importance draws reweighted ({fmt.number(least, 2)} effective ones or more); open: sampled anew "
        "under that prior; crosses: diagnostics are poor."
    )
    factors = cells[best].arrays["factors"]
    return run.drawings.add(f"widths-{signal}", caption, lambda: figures.widths(factors, shown))


def _odds(run: Run, signal: str, models: list[str]) -> Table | None:
    """The probability of each damping under other prior odds of further terms."""
    found = ranking(run, signal, 0)
    shares = over_odds(found) if found else {}
    if not found or not shares:
        return None
    lines = [
        Line([words.model(damping), *(fmt.probability(own[damping]) for own in shares.values())])
        for damping in found.dampings
    ]
    headers = ["damping", *(f"factor {fmt.number(factor, 3)}" for factor in shares)]
    caption = (
        "Probability of each damping where each further term makes a sum so many times as probable before the record "
        f"is seen; everywhere else here the factor is {fmt.number(FURTHER_TERM, 3)}."
    )
    return Table(headers, lines, frozenset({0}), caption)


def _elsewhere(run: Run, signal: str, models: list[str]) -> Table | None:
    """Over windows of the record, and under each noise model."""
    found: dict[str, dict[str, float]] = {}
    noises = _cells(run, signal, models, "noises")
    if run.under_law or len(_cells(run, signal, models, "widths")) < 2:
        return None
    for model in models:
        mode = mode_of(run, signal, 0, model)
        windows = mode.windows if mode else ()
        of_parts = {w.label: w.log_evidence for w in windows if math.isfinite(w.log_evidence)}
        if not of_parts:
            continue
        found[model] = of_parts
        if model in noises:
            under = NoisesContent.of(noises[model])
            found[model] |= {
                f"{words.method(n)}{', chosen' * (n == under.chosen)}": e.log_evidence
                for n, e in under.evidence.items()
            }
    best: dict[str, float] = {}
    for label, log_evidence in (item for logs in found.values() for item in logs.items()):
        best[label] = max(log_evidence, best.get(label, -math.inf))
    headers = [label for label, log_evidence in best.items() if math.isfinite(log_evidence)]
    if not headers:
        return None
    lines = [
        Line([words.model(model), *(fmt.fixed(logs.get(h, math.nan) - best[h], 1) for h in headers)])
        for model, logs in found.items()
    ]
    caption = (
        "Log Bayes factors (nats) to the best of each column, by Laplace's approximation: of parts of the record, "
        "and of all of it under each noise model (the likelier models only)."
    )
    return Table(["model", *headers], lines, frozenset({0}), caption)


@dataclass(frozen=True)
class _Half:
    """What the first half of the record says alone: its log evidence, and how it predicts the second half."""

    log_evidence: float
    stderr: float
    diagnostic: str
    sound: bool
    told: Forecast
    predictive_stderr: float


def _half(run: Run, signal: str, model: str, sampled: Mapping[str, CellResult]) -> _Half | None:
    """By importance sampling where that was done, else by Laplace's approximation."""
    if model in sampled:
        told = HalfContent.of(sampled[model])
        found = told.evidence
        log = math.nan if found.log_evidence is None else found.log_evidence
        sound = found.outcome == OK
        return _Half(log, found.stderr, found.diagnostic, sound, told, told.log_predictive_stderr)
    mode = None if run.under_law else mode_of(run, signal, 0, model)  # of laws that hold exactly
    if mode is None or mode.forecast is None:
        return None
    first = next(w.log_evidence for w in mode.windows if w.label == "first half")
    return _Half(first, math.nan, "Laplace's approximation", True, mode.forecast, math.nan)


def _halves(run: Run, signal: str, models: list[str]) -> Table | None:
    sampled = _cells(run, signal, models, "half")
    halves = {m: half for m in models if (half := _half(run, signal, m, sampled))}
    if not sampled:
        return None
    found = ranking(run, signal, 0)
    whole = {r["model"]: r["log_bayes_factor"] for r in found.rows} if found else {}
    best = max(half.log_evidence for half in halves.values())
    densities = [half.told.log_predictive for half in halves.values()]
    ahead = max(filter(math.isfinite, densities), default=math.nan)  # what is not to be trusted has none
    lines = [
        Line(
            [
                words.model(model),
                fmt.nats(whole.get(model)),
                fmt.nats(half.log_evidence - best, half.stderr),
                fmt.number(half.told.rms / half.told.expected, 3),
                f"{100 * half.told.coverage:.0f} %",
                fmt.nats(half.told.log_predictive - ahead, half.predictive_stderr),
                half.diagnostic,
            ],
            "" if half.sound else "alert",
        )
        for model, half in halves.items()
    ]
    headers = [
        "model", "log Bayes factor", "from the first half", "error / expected", "inside 95 %", "log predictive density",
        "diagnostic",
    ]  # fmt: skip
    caption = (
        "The first half of the record alone: what it says of the models, and how well it predicts the second half. "
        "Error (rms) in units of what its interval expects, share of the samples inside their 95 % interval, and log "
        "density of the second half given the first, against the best (nats)."
    )
    return Table(headers, lines, frozenset({0, 6}), caption)


def _prediction(run: Run, signal: str, models: list[str]) -> Markup | None:
    cells = list(_cells(run, signal, models, "half").items())[: figures.PANELS]
    if not cells:
        return None
    unit = run.unit(signal)
    scale = unit.scale
    shown = {m: (c.arrays["t"], scale * c.arrays["error"], scale * c.arrays["sd"]) for m, c in cells}
    caption = (
        f"{signal}: the second half of the record minus its prediction from the first half, and the 95 % interval "
        "of that prediction; the most probable models."
    )
    recorded = unit.of(run.about(signal).get("quantity") or "angle")
    return run.drawings.add(f"prediction-{signal}", caption, lambda: figures.prediction(shown, recorded))


def _ratios(run: Run, signal: str, models: list[str]) -> Table | None:
    found = ranking(run, signal, 0)
    logs = {frozenset(r["model"].split("+")): r for r in found.rows} if found else {}
    lines = []
    for model, cell in _cells(run, signal, models, "savage_dickey").items():
        for smaller, factor in RatiosContent.of(cell).against.items():
            one, other = (logs.get(frozenset(m.split("+"))) for m in (smaller, model))
            if one is None or other is None:
                continue
            valid = factor.outcome == OK
            lines.append(
                Line(
                    [
                        f"{words.model(smaller)} to {words.model(model)}",
                        fmt.nats(factor.log_bayes_factor, factor.stderr) if valid else fmt.NONE,
                        fmt.nats(
                            one["log_evidence"] - other["log_evidence"],
                            math.hypot(one["stderr"], other["stderr"]),
                        ),
                        factor.outcome,
                    ],
                    "" if valid else "quiet",
                )
            )
    if not lines:
        return None
    caption = (
        "A third check of nested pairs: the log Bayes factor by Savage and Dickey, from the density of the larger "
        "model's posterior where the term is zero, beside the difference of the log evidences."
    )
    headers = ["pair", "Savage–Dickey / nats", "evidence / nats", "outcome"]
    return Table(headers, lines, frozenset({0, 3}), caption)


def _average(run: Run, signal: str, models: list[str]) -> Markup | None:
    cell = run.cell("averaged", signal, 0)
    if cell is None or cell.outcome != OK or cell.arrays["amplitudes"].size < 2:
        return None
    shown = run.unit(signal).displacement
    unit, scale = shown.name, shown.scale
    medians = {m: cell.arrays[f"median/{m}"] for m in models if f"median/{m}" in cell.arrays}
    content = AverageContent.of(cell)
    covered, weighed = content.covered, content.weighed
    part = "" if covered > 0.9995 else f" that hold {fmt.probability(covered)} of the probability"
    how = (
        f" Not sampled, by the weighted draws of the evidence: {fmt.listing(map(words.model, weighed))}."
        if weighed
        else ""
    )
    caption = (
        f"{signal}: equivalent viscous damping ratio against amplitude, averaged over the models{part} by their "
        f"probabilities ({words.method(content.method)}): median and 95 % band; thin: each model's own "
        f"median.{how}"
    )
    grid, band = scale * cell.arrays["amplitudes"], cell.arrays["curve/equivalent_ratio"]
    return run.drawings.add(f"averaged-{signal}", caption, lambda: ratio(grid, band, unit, INK, medians))


PLUGIN = Sensitivity()
