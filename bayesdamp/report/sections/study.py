"""Show the settings of the study."""

import json
from collections.abc import Callable

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.results.run import RunFolder, answer_of
from bayesdamp.report.sections import Section, collapsible, paragraph, stack
from bayesdamp.types import candidate_parts


class StudySection(Section):
    """The section with the damping models, the signals and the known parameters."""

    order = 20
    title = "Settings of the study"

    def render(self, run: RunFolder) -> str:
        """Return sentences on the models, a table of the signals, and (after a click) all settings of the study."""
        sentences: list[str] = []
        dampings = list(dict.fromkeys(candidate_parts(m)[0] for m in run.models))
        if dampings:
            number = f"{len(dampings)} damping models" if len(dampings) > 1 else "one damping model"
            sentences.append(f"The study names {number}: {fmt.listing(map(words.model, dampings))}.")
        terms, laws = run.info.get("damping") or {}, run.info.get("restoring") or {}
        forces = [f"{a['force']} ({words.model(term)})" for term, a in terms.items() if a.get("force")]
        rests = [f"{formula} ({words.law(law)})" for law, formula in laws.items() if formula]
        if forces and rests:
            units = sorted({run.unit(s).base for s in run.signals}, reverse=True)
            sentences.append(
                "Equation of motion: θ̈ + F_damp + F_rest = 0. The damping force F_damp is the sum of the terms of a "
                f"model: {fmt.listing(forces)}. The restoring force F_rest is {fmt.listing(rests, 'or')}. θ is the "
                f"displacement in {' or '.join(units)}, time is in s, and forces are divided by the mass or the "
                "moment of inertia."
            )
        sentences += _systems(run)
        text = json.dumps(run.study, indent=2, ensure_ascii=False)
        details = collapsible("All settings, with their defaults", Markup("<pre>{}</pre>").format(text))
        return stack(*(paragraph(fmt.symbols(sentence)) for sentence in sentences), _signals(run), details)


def _systems(run: RunFolder) -> list[str]:
    """Return sentences that state the restoring law and the known parameters of each signal.

    Signals with the same parameters share a sentence.
    """
    named: dict[str, list[str]] = {}
    for signal in run.study.get("signals") or []:
        system, name = signal.get("system") or {}, str(signal.get("name", ""))
        laws = run.about(name).get("restoring") or [system["restoring"]] if system.get("restoring") else []
        numbers = (system.get("known") or {}).items()
        known = [f"{words.symbol(k).text} = {fmt.digits(v, n=6)}" for k, v in numbers]
        parts = [f"Restoring force: {fmt.listing(map(words.law, laws), 'or')}."] if laws else []
        parts += [f"Known: {fmt.listing(known)}."] if known else []
        derived = (run.info.get("equilibrium") or {}).get(name) or {}
        if "natural_frequency" in derived:  # the whole restoring law is known
            own = run.unit(name).displacement
            at = fmt.number(own.scale * derived["equilibrium"], 4)
            rate = fmt.number(derived["natural_frequency"], 4)
            parts.append(
                f"This gives the equilibrium {at} {own.name} and the natural frequency {rate} rad/s."
            )
        if parts:
            named.setdefault(" ".join(parts), []).append(name)
    if len(named) == 1:
        return list(named)
    return [f"{fmt.listing(names)}: {text}" for text, names in named.items()]


def _signals(run: RunFolder) -> fmt.Table | str:
    """Return a table of what was recorded in each signal, and how much of it was used; "" if there are no signals."""

    def samples(signal: str) -> tuple[str, str]:
        """Return the number of used samples and their duration in s as texts; dashes if no result is stored."""
        answer = answer_of(run, signal) if run.quantity(signal) == "envelope" else None
        task_result = run.task_result("signal", signal, run.repeats(signal)[0])
        if answer is not None and answer.content.envelope is not None:
            w, t = answer.verdict.window, answer.arrays["t"]
            count, duration = answer.content.envelope.samples, w.stop - w.start if w else float(t[-1] - t[0])
        elif task_result is not None and "t" in task_result.arrays:
            t = task_result.arrays["t"]
            count, duration = len(t), float(t[-1] - t[0])
        else:
            return fmt.NONE, fmt.NONE
        return f"{count:,}".replace(",", "\u202f"), fmt.number(duration, 4)

    used = {signal: samples(signal) for signal in run.signals}
    columns: dict[str, Callable[[str], str]] = {
        "signal": str,
        "origin": lambda s: "simulated" if run.is_simulated(s) else "measured",
        "recorded": lambda s: (
            f"{run.unit(s).quantity_name(run.quantity(s))} in {run.unit(s).of(run.quantity(s))}"
        ),
        "repeats": lambda s: str(len(run.repeats(s))),
        "samples used": lambda s: used[s][0],
        "duration / s": lambda s: used[s][1],
    }
    caption = "The records of this run (signals), and the part of each that was used."
    return fmt.Table.of(run.signals, columns, (0, 1, 2), caption) if used else ""


PLUGIN = StudySection()
