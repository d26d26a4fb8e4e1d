"""What was asked: the resolved study in words."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from markupsafe import Markup, escape

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.html import fill, folded
from bayesdamp.report.results.answers import answers, only_answered
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import Section
from bayesdamp.table import Line, Table
from bayesdamp.types import candidate_parts


class Asked(Section):
    """Signals, what is known and what is free, and the methods in use."""

    order = 20
    name = "asked"
    title = "What was asked"

    def applies(self, run: Run) -> bool:
        """In every report."""
        return True

    def render(self, run: Run) -> str:
        """Tables of the resolved study, and its text folded."""
        study = run.study
        text = json.dumps(study, indent=2, ensure_ascii=False)
        details = folded("The resolved study, every setting", Markup("<pre>{}</pre>").format(escape(text)))
        return fill("asked.html", sentences=_sentences(run, study), table=_signals(run), details=details)


def _sentences(run: Run, study: Mapping[str, Any]) -> list[str]:
    found = []
    dampings = list(dict.fromkeys(candidate_parts(m)[0] for m in run.models))
    if dampings:
        count = len(dampings)
        found.append(
            f"{'One damping model was' if count == 1 else f'{count} damping models were'} in play: "
            f"{fmt.listing(words.model(d) for d in dampings)}."
        )
    found.extend(_equation(run))
    found.extend(_systems(run, study))
    sampled = any(run.cells("sampled", signal) for signal in run.signals)
    how = [
        f"Weighed in closed form about each best fit{', the likeliest by sampled motions too' if sampled else ''}."
    ]
    weighed = only_answered(run) and any(a.candidates for a in answers(run))
    found.extend(how if weighed else [])
    found.extend(
        sentence
        for sentence in (
            _used("Estimators", (study.get("estimators") or {}).get("use")),
            _used("Posteriors", (study.get("posterior") or {}).get("samplers"), _noise(run, study)),
            _used("Evidence", (study.get("evidence") or {}).get("methods")),
        )
        if sentence and not only_answered(run)
    )
    if run.info.get("seed") is not None:
        found.append(f"Every random number follows from the seed {run.info['seed']}.")
    return found


def _equation(run: Run) -> list[str]:
    """The equation of motion with the forces in play."""
    own, laws = run.info.get("damping") or {}, run.info.get("restoring") or {}
    forces = [f"{about['force']} ({words.model(term)})" for term, about in own.items() if about.get("force")]
    rests = [f"{formula} ({words.law(law)})" for law, formula in laws.items() if formula]
    if not forces or not rests:
        return []
    metres = " θ stands for the position in m." if any(run.unit(s).base == "m" for s in run.signals) else ""
    return [
        f"Equation of motion: θ̈ + F_damp + F_rest = 0, where F_damp is made of {fmt.listing(forces)} and F_rest is "
        f"{fmt.listing(rests, 'or')}; θ in rad, time in s.{metres}"
    ]


def _systems(run: Run, study: Mapping[str, Any]) -> list[str]:
    """What is known of each signal's oscillator; signals of which the same is known share a sentence."""
    named: dict[str, list[str]] = {}
    for table in study.get("signals") or []:
        system, name = table.get("system") or {}, str(table.get("name", ""))
        laws = run.about(name).get("restoring") or [system["restoring"]] if system.get("restoring") else []
        text = f"Restoring force: {fmt.listing(map(words.law, laws), 'or')}. " if laws else ""
        if len(laws) > 1:  # what is to be found is each law's own
            system = {**system, "free": {}}
        text = f"{text}{_known(system)}{_rest(run, name)}".rstrip()
        if text:
            named.setdefault(text, []).append(name)
    if len(named) == 1:
        return list(named)
    return [f"{fmt.listing(names)}: {text}" for text, names in named.items()]


def _known(system: Mapping[str, Any]) -> str:
    numbers = system.get("known") or {}
    known = [f"{words.symbol(k).text} = {fmt.given(v)}" for k, v in numbers.items() if _is_number(v)]
    free = [words.symbol(k).text for k in system.get("free") or {}]
    said = [f"Known: {fmt.listing(known)}."] if known else []
    said += [f"To be found: {fmt.listing(free)}."] if free else []
    return " ".join(said)


def _rest(run: Run, signal: str) -> str:
    """The derived equilibrium and natural frequency, where the whole restoring law is known."""
    derived = (run.info.get("equilibrium") or {}).get(signal) or {}
    if "natural_frequency" not in derived:
        return ""
    own = run.unit(signal).displacement
    at = fmt.number(own.scale * derived["equilibrium"], 4)
    rate = fmt.number(derived["natural_frequency"], 4)
    return f" From this follow the rest position {at} {own.name} and the natural frequency {rate} rad/s."


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _noise(run: Run, study: Mapping[str, Any]) -> str:
    if run.under_law:
        return ", with white noise of the size that no deviation takes"
    noise = (study.get("posterior") or {}).get("noise")
    return f", with {words.method(noise)} noise" if isinstance(noise, str) else ""


def _used(what: str, names: object, suffix: str = "") -> str:
    if names is None:
        return ""
    if isinstance(names, str):
        return f"{what}: {names}{suffix}."
    chosen = [str(name) for name in names] if isinstance(names, (list, tuple)) else []
    return (
        f"{what}: {fmt.listing(map(words.method, chosen))}{suffix}." if chosen else f"{what}: switched off."
    )


def _signals(run: Run) -> Table | str:
    lines = []
    for signal in run.signals:
        about = run.about(signal)
        cell = run.cell("signal", signal, run.repeats(signal)[0])
        t = cell.arrays.get("t") if cell else None
        samples = f"{len(t):,}".replace(",", "\u202f") if t is not None else fmt.NONE
        span = fmt.number(float(t[-1] - t[0]), 4) if t is not None and len(t) else fmt.NONE
        kind = "simulated" if run.simulated(signal) else "measured"
        unit, quantity = run.unit(signal), str(about.get("quantity") or "angle")
        recorded = f"{unit.called(quantity)} in {unit.of(quantity)}"
        lines.append(Line([signal, kind, recorded, str(len(run.repeats(signal))), samples, span]))
    if not lines:
        return ""
    headers = ["signal", "origin", "recorded", "repeats", "samples used", "duration / s"]
    return Table(headers, lines, frozenset({0, 1, 2}))


PLUGIN = Asked()
