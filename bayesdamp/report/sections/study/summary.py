"""What to believe and what not: the first thing on the page."""

from __future__ import annotations

import math
from typing import Any

from markupsafe import Markup

from bayesdamp.outcomes import Status, status_of
from bayesdamp.report import words
from bayesdamp.report.html import Line, Table, fill, folded
from bayesdamp.report.results.answers import only_answered, verdicts
from bayesdamp.report.results.reading import (
    coefficients,
    damping_of,
    label,
    models_by_rank,
    ranking,
    summary_rows,
    truth,
)
from bayesdamp.report.results.run import Run, rows_of
from bayesdamp.report.results.verdict import verdict
from bayesdamp.report.sections._section import Section
from bayesdamp.report.style import colour
from bayesdamp.store.contents.records import NoiseContent, RecordContent
from bayesdamp.types import OK

_CARDS = 4
SECOND = "A second opinion: what sampling says if every law held exactly"
HELD = (
    "Every law is held to be exact here, so that one which is right to a few per cent is said not to fit, and its "
    "intervals are too narrow. Of measured records the answer above is the one to quote."
)
SAME = "What chains and evidence say with the same deviations from the laws"


class Summary(Section):
    """The verdict of each signal, the warnings, and the cells that ended with a sentence."""

    order = 10
    name = "summary"
    title = "Conclusions and caveats"

    def applies(self, run: Run) -> bool:
        """In a study's report that went on to samplers and evidence."""
        return run.info.get("kind") is None and not only_answered(
            run
        )  # a calibration has a verdict of its own

    def render(self, run: Run) -> str:
        """A card a signal, the overview, and what ended with a sentence."""
        signals = run.signals
        cards = [_card(run, signal, run.repeats(signal)[0]) for signal in signals]
        many = len(signals) > _CARDS or any(len(run.repeats(s)) > 1 for s in signals)
        overview = _overview(run) if many else None
        if len(cards) > _CARDS:
            rest = fill("summary.html", cards=cards[_CARDS:], overview=None, failed=[])
            overview = fill("stack.html", parts=[folded("The other signals, one by one", rest), overview])
        body = fill("summary.html", cards=cards[:_CARDS], overview=overview, failed=_by_sentence(run))
        if not verdicts(run):
            return body
        weighed = (run.study.get("posterior") or {}).get("deviation") == "auto"
        measured = any(not run.simulated(s) for s in run.signals)
        held = Markup("<p>{}</p>").format(HELD) if weighed and measured else Markup("")
        return folded(SAME if run.under_law else SECOND, held, body)


def _by_sentence(run: Run) -> list[tuple[str, list[str]]]:
    """The sentences that cells ended with, each with the names of its cells."""
    found: dict[str, list[str]] = {}
    for cell in run.not_ok():
        if status_of(cell.outcome) is Status.PRUNED:  # no fault: the evidence section has them
            continue
        found.setdefault(cell.outcome, []).append(cell.name)
    return list(found.items())


def _card(run: Run, signal: str, repeat: int) -> dict[str, Any]:
    found = ranking(run, signal, repeat)
    ranked = models_by_rank(run, signal, repeat)
    best = ranked[0] if ranked else None
    believe: list[str] = []
    doubt: list[str] = []
    if found:
        said = verdict(run, signal, repeat)
        claim = said.sentence[:1].upper() + said.sentence[1:]
        if len(found.rows) > 1:
            _weigh(run, found, believe, doubt)
            if said.rivals:
                shares = [f"{name} ({words.probability(p)})" for name, p in said.rivals]
                doubt.append(
                    f"that there is nothing else: the record does not rule out that {words.listing(shares, 'or')}. "
                    "Each number is the probability of that form beside the damping named above, against that damping "
                    "alone."
                )
        else:
            if not said.misfit:
                claim = f"Damping is {label(found.best)}: the only model that was studied."
            doubt.append("that the damping is of this kind: no other model was compared.")
    elif best and len(ranked) == 1:
        claim = f"Damping was taken to be {words.model(best)}; no other model was compared."
    elif best:
        claim = "Which damping it is was not decided: no evidence was computed."
        best = _only_posterior(run, signal, repeat, ranked)
    else:
        outcome = str(run.about(signal).get("outcome", OK))
        claim = "Nothing was computed for this signal" + (f": {outcome}." if outcome != OK else ".")
    sizes = _sizes(run, signal, repeat, best, believe, doubt) if best else []
    if best and not run.under_law:  # these are of fits under laws that hold exactly
        _fit(run, signal, repeat, best, doubt)
        _friction(run, signal, repeat, best, doubt)
    about = run.about(signal)
    content = RecordContent.maybe(run.cell("signal", signal, repeat))
    if not found and content and content.anomalies:
        doubt.append(f"that the record is a free decay: {words.listing(content.anomalies)}.")
    doubt += [f"the record as it was read: {note}" for note in run.provenance(signal).warnings]
    kind = "simulated record" if run.simulated(signal) else "measured record" if about else "record"
    repeats = run.repeats(signal)
    return {
        "signal": signal,
        "kind": kind,
        "repeat": repeats.index(repeat),
        "repeats": len(repeats),
        "claim": claim,
        "sizes": sizes,
        "fit": "" if run.under_law else _verdict(run, signal, repeat, best),
        "believe": believe,
        "doubt": doubt,
        "colour": colour(best) if best else None,
    }


def _weigh(run: Run, found, believe: list[str], doubt: list[str]) -> None:
    best = damping_of(found.best)
    other = next((r for r in found.rows if damping_of(r) != best), None)
    if other is not None and found.dampings[damping_of(other)] < 0.01:
        believe.append(
            f"the order of the dampings: the next, {label(other)}, has a log Bayes factor of "
            f"{words.nats(other['log_bayes_factor'])} ({words.method(found.method)})."
        )
    elif other is not None:
        doubt.append(
            f"that the question is settled: {words.model(damping_of(other))} keeps a probability of "
            f"{words.probability(found.dampings[damping_of(other)])}."
        )
    law = next((r for r in found.rows[1:] if damping_of(r) == best), None)
    if law is not None and law["probability"] >= 0.01:
        doubt.append(
            f"that the restoring law is settled: {label(law)} keeps a probability of "
            f"{words.probability(law['probability'])}."
        )
    for other, name in found.others.items():
        doubt.append(f"the order of the models: {words.method(other)} puts {name} first.")
    left = sum(status_of(row["outcome"]) is Status.PRUNED for row in found.rows)
    if left:
        believe.append(
            f"that {left} more model{'s' if left > 1 else ''} could be pruned unweighed; the evidence says why."
        )
    for row in rows_of(run.evidence, signal=found.best["signal"], repeat=found.best["repeat"]):
        counts = found.method != "combined" or row["method"] == "combined"
        if row["outcome"] != OK and status_of(row["outcome"]) is not Status.PRUNED and counts:
            doubt.append(f"that {label(row)} was weighed by {words.method(row['method'])}: {row['outcome']}.")


def _only_posterior(run: Run, signal: str, repeat: int, ranked: list[str]) -> str | None:
    with_rows = [m for m in ranked if summary_rows(run, signal, repeat, m)[1]]
    return with_rows[0] if len(with_rows) == 1 else None


def _sizes(run: Run, signal: str, repeat: int, model: str, believe: list[str], doubt: list[str]) -> list[str]:
    sampler, rows = summary_rows(run, signal, repeat, model)
    sentences = []
    for name in coefficients(run, model):
        row = next((r for r in rows if r["parameter"] == name), None)
        if row is None:
            continue
        unit = words.unit(row["unit"])
        symbol = words.symbol(name)
        text = f"{symbol.meaning[:1].upper()}{symbol.meaning[1:]} {symbol.text} = "
        text += f"{words.with_error(row['mean'], row['sd'])} {unit}, 95 % credible interval "
        text += f"{words.interval(row['q2.5'], row['q97.5'])}"
        true = truth(run, signal, name)
        if math.isfinite(true):
            inside = row["q2.5"] <= true <= row["q97.5"]
            text += f"; truth {words.given(true)}, {'inside' if inside else 'outside'}"
        sentences.append(text)
    outcomes = {r["outcome"] for r in rows_of(run.posteriors, signal=signal, repeat=repeat, model=model)}
    if not sentences and (estimated := _estimated(run, signal, repeat, model)):
        return estimated
    doubt.extend(f"the posterior without a second look: {outcome}" for outcome in sorted(outcomes - {OK}))
    if sentences and outcomes == {OK}:
        exact = any(math.isfinite(r["rhat"]) for r in rows)
        found = "converged" if exact else "is close to the posterior by its importance weights"
        believe.append(
            f"the intervals, if the model and its noise are right: {words.method(sampler)} {found}."
        )
    if not sentences:
        doubt.append("any size of the damping from this table: no posterior was computed for this model.")
    return sentences


AGREE = 1e-6
"""Estimates whose spread is below this share of them are one value."""


def _estimated(run: Run, signal: str, repeat: int, model: str) -> list[str]:
    """What the refined estimates say of each coefficient, where there is no posterior to say more."""
    sentences = []
    for name in coefficients(run, model):
        rows = rows_of(
            run.estimates, signal=signal, repeat=repeat, model=model, stage="refined", parameter=name
        )
        values = [r["value"] for r in rows if r["outcome"] == OK]
        if not values:
            continue
        low, high, unit = min(values), max(values), words.unit(rows[0]["unit"])
        count = f"{len(values)} trajectory fit{'s' if len(values) > 1 else ''}"
        symbol = words.symbol(name).text
        if high - low <= AGREE * abs(high):
            text = f"{symbol} = {words.number(high, 6)} {unit} by {count}"
            text += ", which agree" if len(values) > 1 else ""
        else:
            text = f"{symbol} from {words.number(low, 6)} to {words.number(high, 6)} {unit} by {count}"
        true = truth(run, signal, name)
        sentences.append(text + (f"; truth {words.given(true)}" if math.isfinite(true) else ""))
    return sentences


WINDOW_SPREAD = 3.0
"""Of several windows and coefficients the largest move is seldom larger by chance."""


def _fit(run: Run, signal: str, repeat: int, model: str, doubt: list[str]) -> None:
    for row in rows_of(run.fits, signal=signal, repeat=repeat, model=model)[:1]:
        if math.isfinite(row["window_spread"]) and row["window_spread"] > WINDOW_SPREAD:
            doubt.append(
                "the width of the intervals: between parts of the record the coefficients move by "
                f"{words.number(row['window_spread'], 2)} of the standard deviations that chance allows them."
            )
        if math.isfinite(row["predictive_p"]) and not 0.01 < row["predictive_p"] < 0.99:
            doubt.append(
                "that the model says all there is: records drawn from it look different "
                f"(predictive p {words.number(row['predictive_p'], 2)})."
            )


AS_GOOD = 3.0
"""Nats within which another ε suits a record as well."""


def _friction(run: Run, signal: str, repeat: int, model: str, doubt: list[str]) -> None:
    """Coefficients that move by more than their standard deviation with an ε that suits the record as well."""
    cell, names = run.cell("noise", signal, repeat), coefficients(run, model)
    if cell is None or cell.outcome != OK:
        return
    chosen = NoiseContent.of(cell)
    if not set(chosen.friction) & set(names):
        return
    tried = [t for t in chosen.epsilons if t.outcome == OK]
    best = max((t.log_evidence for t in tried), default=math.nan)
    found = [t.coefficients for t in tried if best - t.log_evidence < AS_GOOD]
    moved = []
    for row in summary_rows(run, signal, repeat, model)[1]:
        values = [one[row["parameter"]][0] for one in found if row["parameter"] in one]
        if row["parameter"] in names and values and max(values) - min(values) > row["sd"]:
            by = words.number(max(values) - min(values), 2)
            moved.append(f"{words.symbol(row['parameter']).text} by {by} {words.unit(row['unit'])}")
    if moved:
        doubt.append(
            "the width of the intervals, which are under one ε of friction: with others that suit the record as well "
            f"the fit of all dampings moves {words.listing(moved)}."
        )


def _verdict(run: Run, signal: str, repeat: int, model: str | None) -> str:
    rows = rows_of(run.fits, signal=signal, repeat=repeat, model=model)
    said = rows[0]["verdict"] if rows else ""
    return f"The fit: {said}{'' if said.endswith('.') else '.'}" if said else ""


def _overview(run: Run) -> Table:
    lines = []
    for signal in run.signals:
        repeats = run.repeats(signal)
        found = [r for r in (ranking(run, signal, repeat) for repeat in repeats) if r]
        wins: dict[str, int] = {}
        for one in found:
            wins[one.best["model"]] = wins.get(one.best["model"], 0) + 1
        order = sorted(wins, key=lambda m: -wins[m])
        best = words.listing(f"{words.model(m)} ({wins[m]} of {len(found)})" for m in order)
        if len(found) == 1:
            best = words.model(order[0])
        lowest = min((one.best["probability"] for one in found), default=math.nan)
        lines.append(Line([signal, str(len(repeats)), best or "not decided", words.probability(lowest)]))
    headers = ["signal", "repeats", "best model (in so many repeats)", "its probability, at least"]
    return Table(headers, lines, frozenset({0, 2}), "All signals and repeats")


PLUGIN = Summary()
