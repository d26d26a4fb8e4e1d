"""The answer: the first thing on the page."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.outcomes import reason_of
from bayesdamp.report import words
from bayesdamp.report.figures import answer as figures
from bayesdamp.report.figures.curves import exponent
from bayesdamp.report.figures.record import motions
from bayesdamp.report.html import fill, folded, paragraph
from bayesdamp.report.results.answers import Answer, answer_of
from bayesdamp.report.results.checks import Check, Checks, sampled
from bayesdamp.report.results.overview import ANCHOR
from bayesdamp.report.results.reading import models_by_rank, ranking
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import Section, by_signal
from bayesdamp.store.contents import WeighedCandidate
from bayesdamp.table import Table
from bayesdamp.types import OK
from bayesdamp.verdict.parts import Coefficient, Grade, Motion
from bayesdamp.verdict.tables import decay_table, modes_table, number, quality_of, ratios_table
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import energy_of, extrapolated, given, loses_like

CAPTION = (
    "Equivalent damping ratio: level means viscous, rising to small amplitudes friction, to large ones drag; "
    "a law whose line leaves both bands is not this record's. What the fit leaves should look like noise: a "
    "wave in it is what none of these laws explains. Energy lost in a cycle: the highest line is the term that brakes "
    "most at that amplitude."
)
MEASURED = (
    "Equivalent damping ratio, measured without a law: level means viscous, rising to small amplitudes friction, to "
    "large ones drag. The law that fits best contradicts it and is not drawn. Energy lost in a cycle: from this ratio."
)


LEVELS = (
    "Left: the level as recorded, the ends of the decay, and the best damping sum with its law's deviation, ± 2 sd. "
    "Right: what that leaves, and the exponent of the velocity that the loss grows with."
)
EMBEDDED = 24
"""Envelopes up to which the page holds their pictures; beyond, it shows those in `figures/`."""
SHOWN = 0.005
"""Probability from which a damping sum is listed."""
MOTIONS = (
    "Each oscillation has its own line: falling straight on the right, it dies down as viscous damping would have it; "
    "level, something drives it; rising, it is fed. One decay would have one line that follows the record's edge."
)
EXCITED = (
    "Left to itself the amplitude would only fall; here it rises and falls by chance, and how fast it falls is not its "
    "damping."
)
EXPONENT = (
    "The damping force as one power of the velocity: how probable each exponent is, its 95 % interval below. A hill "
    "on a dashed line is that damping; one between two lines is a sum, or none of the three."
)


class AnswerSection(Section):
    """The verdict of each record: a sentence, three numbers, one picture, the checks of it."""

    order = 5
    title = "Which damping, and how large"

    def applies(self, run: Run) -> bool:
        """Apply to every run but a calibration, which has a verdict of its own."""
        return run.info.get("kind") is None

    def render(self, run: Run) -> str:
        """Show one block a record."""
        if not run.signals:
            return paragraph("The folder holds no signal yet: run the study.")
        return by_signal(run, _block, run.signals, ANCHOR)


def _block(run: Run, signal: str) -> Markup:
    answer = answer_of(run, signal, run.repeats(signal)[0])
    v = answer.verdict if answer else None
    own = Checks(run, signal)
    read = [
        Check(f"The record as it was read: {note}", fails=True) for note in run.provenance(signal).warnings
    ]
    checks = [*read, *sorted([*sampled(run, signal), *own.all()], key=lambda c: not c.fails)]
    numbers, energy, remarks, parts = (), (), v.remarks if v else (), []
    if answer is not None and v is not None:
        if v.quantity == "envelope":
            numbers, parts = _numbers(v), _decay(run, signal, answer)
            remarks = (*([f"The decay {v.window.why}."] if v.window else []), *v.remarks)
        elif v.grade is Grade.NO_FREE_DECAY:
            parts = [_motions(run, signal, v), modes_table(v.modes, v.motion)]
        else:
            numbers, energy, parts = _numbers(v), energy_of(v), _views(run, signal, answer)
    return fill(
        "answer.html",
        sentence=v.sentence if v else _why_none(run, signal),
        numbers=numbers,
        energy=energy,
        remarks=remarks,
        checks=checks,
        table=own.table() or "",
        parts=parts,
    )


def _views(run: Run, signal: str, answer: Answer) -> list[object]:
    """Return the pictures and tables of an answer."""
    v, own = answer.verdict, run.unit(signal).displacement
    unit, recorded = v.damping_ratio[0].unit if v.damping_ratio else "rad", own.of(run.quantity(signal))
    draw = partial(figures.answer, answer.arrays, unit, v.damping, recorded)
    caption = f"{CAPTION} This record's ratio is measured without a law." if v.law_free else CAPTION
    caption = MEASURED if v.contradicted else caption
    return [
        run.drawings.add(f"answer-{signal}", caption, draw, narrow=True),
        _exponent(run, signal, answer),
        ratios_table(v.damping_ratio, "Damping ratio against amplitude", parts=True),
        _coefficients(v) if v.coefficients else "",
        folded("All damping models that were compared", _candidates(answer, recorded, own.scale)),
    ]


def _decay(run: Run, signal: str, answer: Answer) -> list[object]:
    """Return the picture and the table of an answer on an envelope, and how probable each damping is."""
    v, embed = answer.verdict, len(run.signals) <= EMBEDDED
    picture = run.drawings.show(f"answer-{signal}", LEVELS, answer.arrays["picture"].tobytes(), embed)
    table = decay_table(v.decay_rate, v.quality_factor_at) if v.decay_rate else ""
    return [picture, table, _weighed(v)]


def _weighed(v: Verdict) -> Markup | str:
    """How probable each damping sum is, and each term in any sum."""
    if not v.damping:
        return ""
    sums, terms = (
        fmt.listing(
            f"{words.model(name)} {fmt.probability(p)}" for name, p in probabilities.items() if p >= SHOWN
        )
        for probabilities in (v.probabilities, {share.term: share.probability for share in v.energy})
    )
    return Markup("<p>Probabilities: {}. Of each term, in any sum: {}.</p>").format(sums, terms)


def _why_none(run: Run, signal: str) -> str:
    """Say why a record has no answer, and what there is."""
    repeat = run.repeats(signal)[0]
    cell = run.cell("answer", signal, repeat)
    outcomes = [str(run.about(signal).get("outcome", OK)), cell.outcome if cell is not None else OK]
    why = reason_of(next((o for o in outcomes if o != OK), "")).rstrip(".")
    models = models_by_rank(run, signal, repeat)
    if not models:
        return f"Nothing was computed for this signal{': ' * bool(why)}{why}."
    if why:
        return f"Which damping it is was not decided: {why}."
    if len(models) == 1:
        return f"Damping was assumed to be {words.model(models[0])}; no other model was compared."
    missing = "" if ranking(run, signal, repeat) else ": no evidence was computed"
    return f"Which damping it is was not decided{missing}."


def _motions(run: Run, signal: str, v: Verdict) -> Markup | str:
    """The picture of what is no free decay; nothing where the record is not stored, or no oscillation is told."""
    cell = run.cell("signal", signal, run.repeats(signal)[0])
    if cell is None or "t" not in cell.arrays or not v.modes:
        return ""
    quantity = run.quantity(signal)
    unit = run.unit(signal).displacement
    t, y = cell.arrays["t"], cell.arrays["y"] * unit.scale
    axis = f"{unit.called(quantity)} / {unit.of(quantity)}"
    draw = partial(motions, t, y, v.modes, quantity, axis)
    caption = EXCITED if v.motion is Motion.EXCITED else MOTIONS
    return run.drawings.add(f"motions-{signal}", caption, draw, narrow=True)


def _exponent(run: Run, signal: str, answer: Answer) -> Markup | str:
    """The picture of the power law's exponent; nothing where there is none."""
    e, draws = answer.verdict.exponent, answer.arrays.get("exponent")
    if e is None or draws is None:
        return ""
    title = f"The damping force {loses_like(e, answer.verdict.damping)}"
    draw = partial(exponent, draws, (e.value, e.low, e.high), title)
    return run.drawings.add(f"exponent-{signal}", EXPONENT, draw, narrow=True)


def _numbers(v: Verdict) -> list[tuple[str, str]]:
    """Return what stands in large figures: the frequency, and the damping ratio and Q in the middle of the record."""
    if v.quantity == "envelope":
        name, size = ("Q", v.quality_factor) if v.quality_factor else ("decay rate", v.rate)
        found = [("frequency", f"{v.frequency.value:.9g} Hz")] if v.frequency else []
        return [*found, (name, f"{number(size)} {size.unit}".rstrip())] if size else found
    found, f, at = [], v.frequency, v.frequency_at
    beyond = f is not None and at is not None and extrapolated(f, at)
    if at is not None and (f is None or beyond):
        seen = fmt.with_interval(at.value, at.low, at.high, " Hz")
        found.append((f"frequency at {at.amplitude:.2g} {at.unit}", seen))
    if f is not None:
        name = "natural frequency" + (", extrapolated to small oscillations" if beyond else "")
        interval = fmt.with_interval(f.value, f.low, f.high, f" {f.unit}")
        found.append((name, f"{f.value:.5g} {f.unit} (specified)" if given(f) else interval))
    if v.damping_ratio:
        r = v.damping_ratio[len(v.damping_ratio) // 2]
        where = f"at {r.amplitude:.2g} {r.unit}"
        size = fmt.with_interval(r.value, r.low, r.high, " %", 100)
        found += [(f"equivalent damping ratio {where}", size), (f"Q {where}", quality_of(r))]
    return found


def _coefficients(v: Verdict) -> Table:
    columns: dict[str, Callable[[Coefficient], str]] = {
        "parameter": lambda c: words.symbol(c.name).text,
        "value (95 %)": lambda c: fmt.with_interval(c.value, c.low, c.high),
        "sd from noise": lambda c: f"{c.sd_noise:.2g}",
        "sd from the law": lambda c: f"{c.sd_law:.2g}",
        "unit": lambda c: words.unit(c.unit),
    }
    caption = f"Coefficients under {words.model(v.damping)} damping, {words.law(v.restoring)}"
    return Table.of(v.coefficients, columns, (0, 4), caption)


def _candidates(answer: Answer, unit: str, scale: float) -> Table:
    """The sums under each restoring law. scale: of `unit`, the recorded quantity's, in what is computed in."""
    rows = [r for r in answer.candidates if r.outcome == OK]
    log = {id(r): r.exact if r.log_evidence is None else r.log_evidence for r in rows}
    top, top_exact = max(log.values(), default=0.0), max((r.exact for r in rows), default=0.0)
    columns: dict[str, Callable[[WeighedCandidate], str]] = {
        "damping": lambda r: words.model(r.damping),
        "restoring law": lambda r: words.law(r.restoring),
        "log Bayes factor": lambda r: f"{log[id(r)] - top:.1f}",
        "the same under exact laws": lambda r: f"{r.exact - top_exact:.1f}",
        f"rms that the fit leaves, {unit}": lambda r: "" if r.rms is None else f"{scale * r.rms:.3g}",
    }
    ranked = sorted(rows, key=lambda r: -log[id(r)])
    return Table.of(ranked, columns, (0, 1), "Log Bayes factors to the best, in nats")


PLUGIN = AnswerSection()
