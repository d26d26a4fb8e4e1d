"""What was asked: the resolved study in words."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from markupsafe import Markup, escape

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.html import fill, folded
from bayesdamp.report.results.answers import answer_of, answers, only_answered
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import Section
from bayesdamp.table import Table
from bayesdamp.types import candidate_parts


class Asked(Section):
    """Signals, what is known and what is free, and the methods in use."""

    order = 20
    title = "What was asked"

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
    found += [*_equation(run), *_systems(run, study)]
    if not only_answered(run):
        found += [
            _used("Estimators", (study.get("estimators") or {}).get("use")),
            _used("Posteriors", (study.get("posterior") or {}).get("samplers"), _noise(run, study)),
            _used("Evidence", (study.get("evidence") or {}).get("methods")),
        ]
    elif any(a.candidates for a in answers(run)):
        sampled = any(run.cells("sampled", signal) for signal in run.signals)
        too = ", the likeliest by sampled motions too" if sampled else ""
        found.append(f"Weighed in closed form about each best fit{too}.")
    if run.info.get("seed") is not None:
        found.append(f"Every random number follows from the seed {run.info['seed']}.")
    return [sentence for sentence in found if sentence]


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
    known = [f"{words.symbol(k).text} = {fmt.given(v)}" for k, v in numbers.items()]
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


def _noise(run: Run, study: Mapping[str, Any]) -> str:
    if run.under_law:
        return ", with white noise of the size that no deviation takes"
    noise = (study.get("posterior") or {}).get("noise")
    return f", with {words.method(noise)} noise" if isinstance(noise, str) else ""


def _used(what: str, names: str | Sequence[str] | None, suffix: str = "") -> str:
    if names is None:
        return ""
    if not names:
        return f"{what}: switched off."
    return f"{what}: {names if isinstance(names, str) else fmt.listing(map(words.method, names))}{suffix}."


def _signals(run: Run) -> Table | str:
    def recorded(signal: str) -> str:
        unit, quantity = run.unit(signal), run.quantity(signal)
        return f"{unit.called(quantity)} in {unit.of(quantity)}"

    def samples(signal: str) -> tuple[int, float] | None:
        """Return the number of samples and the duration."""
        repeat = run.repeats(signal)[0]
        answer, cell = answer_of(run, signal, repeat), run.cell("signal", signal, repeat)
        if answer is not None and answer.envelope is not None:
            w, t = answer.verdict.window, answer.arrays["t"]
            return answer.envelope.samples, w.stop - w.start if w else float(t[-1] - t[0])
        t = cell.arrays.get("t") if cell else None
        return None if t is None or not len(t) else (len(t), float(t[-1] - t[0]))

    used = {signal: samples(signal) for signal in run.signals}
    columns: dict[str, Callable[[str], str]] = {
        "signal": str,
        "origin": lambda s: "simulated" if run.simulated(s) else "measured",
        "recorded": recorded,
        "repeats": lambda s: str(len(run.repeats(s))),
        "samples used": lambda s: f"{found[0]:,}".replace(",", "\u202f") if (found := used[s]) else fmt.NONE,
        "duration / s": lambda s: fmt.number(found[1], 4) if (found := used[s]) else fmt.NONE,
    }
    return Table.of(run.signals, columns, (0, 1, 2)) if used else ""


PLUGIN = Asked()
