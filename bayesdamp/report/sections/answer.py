"""Show the answer on each record: the verdict on its damping, with figures, tables and checks."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures import answer as figures
from bayesdamp.report.results.checks import Check, RecordChecks, sampling_checks
from bayesdamp.report.results.run import ANCHOR, RunFolder, StoredAnswer, answer_of, no_verdict_sentence
from bayesdamp.report.sections import SignalSection, collapsible, fill, paragraph
from bayesdamp.store.results import ComparedCandidate
from bayesdamp.types import OK, level_unit
from bayesdamp.verdict.parts import Coefficient, Grade, decay_table, modes_table, ratios_table
from bayesdamp.verdict.words import energy_sentences, noise_sentence

SHAPES = (
    "a level curve means viscous damping, a rise towards small amplitudes means friction, and a rise towards large "
    "amplitudes means drag"
)
CAPTION = (
    "Upper left: the record and the fit of the damping model that the legend names (only their amplitudes, if the "
    "record was averaged over cycles). The fit may deviate from its laws, unless they are assumed to be exact. Upper "
    "right: the equivalent viscous damping ratio of this record against amplitude (thick black line) with its 95 % "
    "interval (grey band), {measured}, and each compared damping model, fitted with exact laws (coloured lines). In "
    f"this panel, {SHAPES}. A model whose line leaves the bands does not describe this record. Lower left: the "
    "residual, which is the record minus the fit. It "
    "should look like noise; a wave in the residual is motion that the fit does not explain. Lower right: the energy "
    "that each term of the named model dissipates in a cycle, against amplitude, divided by the mass or the moment of "
    "inertia; here too the laws are exact."
)
TWICE = (
    "both averaged over the compared models by their probability, the 95 % interval that is measured without assuming "
    "a damping law (brown band)"
)
ONCE = "both measured without assuming a damping law"
"""`TWICE`, `ONCE`: the part of `CAPTION` that says how the damping ratio was measured."""
UNMEASURED = " There is no brown band: the damping ratio could not be measured without a damping law."
MEASURED = (
    "Top: the record. Lower left: its equivalent viscous damping ratio against amplitude (black line) with the 95 % "
    f"interval (grey band), both measured without assuming a damping law. In this panel, {SHAPES}. The law that "
    "fits best contradicts this measurement and is not drawn. Lower right: the energy lost in a cycle, divided by "
    "the mass or the moment of inertia, as computed from this ratio."
)
LEVELS = (
    "Left: the recorded level of the oscillation (grey), the start and the end of the part that is used (vertical "
    "lines), the level of the noise floor (dotted line, if there is one), and the fit of the most probable damping "
    "model, including its deviation from the law (blue line; band: ± 2 standard deviations). Right: readings averaged "
    "over short intervals, minus the fit (orange band: ± 2 standard deviations of the noise)."
)
PARTS_OF_SD = (
    "The standard deviation (sd) has two parts: one is due to the noise of the record, the other to deviations of the "
    "damping from its law. The interval includes both."
)
RATIOS = (
    "Equivalent viscous damping ratio and Q = 1/(2 × damping ratio) at amplitudes of this record, with 95 % intervals "
    f"in brackets. {PARTS_OF_SD}"
)
"""`RATIOS` is the caption of the table of damping ratios. `PARTS_OF_SD` is also part of the caption of the table of
coefficients."""
LEAST_SHOWN = 0.005
"""Smallest probability of a sum of damping terms, or of a term, that is listed for an envelope."""


class AnswerSection(SignalSection):
    """The section with the verdict on each record: its sentence, a figure, tables, and checks."""

    order = 5
    title = "Kind and size of the damping"
    anchor = ANCHOR

    def applies(self, run: RunFolder) -> bool:
        """Return whether the run is a study or a comparison, and not a run of another kind, such as a calibration."""
        return run.info.get("kind") is None

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return True: every record is shown, also without a verdict."""
        return True

    def render(self, run: RunFolder) -> Markup:
        """Return the verdict on each record as HTML, or a sentence that there are no results yet."""
        if not run.signals:
            text = "This folder does not contain any results yet. Run the study with bayesdamp study."
            return paragraph(text)
        return self.by_signal(run, run.signals)

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return the verdict on a record as HTML, with its figures, tables and checks."""
        answer, comparison = answer_of(run, signal), RecordChecks(run, signal)
        warnings = run.provenance(signal).warnings
        checks = [Check(f"Warning from reading the record: {text}", fails=True) for text in warnings]
        checks += sorted([*sampling_checks(run, signal), *comparison.all()], key=lambda c: not c.fails)
        sentences, remarks, parts = [], (), list[object]()
        if answer is None:
            claim = no_verdict_sentence(run, signal)
        else:
            v = answer.verdict
            claim, remarks = v.sentence, v.remarks
            if v.quantity == "envelope":
                if v.window:
                    remarks = (f"The decay {v.window.why.replace('; ', ' and ')}.", *remarks)
                about = answer.content.envelope
                draw = partial(figures.envelope, answer.arrays, v, level_unit(about.unit if about else ""))
                parts.append(run.drawings.add(f"answer-{signal}", LEVELS, draw))
                if v.decay_rate:
                    parts.append(decay_table(v.decay_rate, v.quality_factor_at))
                if v.damping:
                    by_term = {share.term: share.probability for share in v.energy}
                    sums, terms = map(_list_probabilities, (v.probabilities, by_term))
                    text = (
                        f"Probability of each damping model: {sums}. Probability that the damping contains a term, "
                        f"alone or in a sum: {terms}."
                    )
                    parts.append(paragraph(text))
            elif v.grade is Grade.NO_FREE_DECAY:
                parts.append(modes_table(v.modes, v.motion))
            else:
                sentences, parts = list(energy_sentences(v)), _views(run, answer)
            sentences += noise_sentence(v)
        return fill(
            "answer.html", claim=claim, sentences=sentences, remarks=remarks, checks=checks, parts=parts
        )


def _list_probabilities(probabilities: Mapping[str, float]) -> str:
    """Return a list in words of damping models or terms with their probabilities, without those below `LEAST_SHOWN`."""
    shown = {name: p for name, p in probabilities.items() if p >= LEAST_SHOWN}
    return fmt.listing(f"{words.model(name)} {fmt.probability(p)}" for name, p in shown.items())


def _views(run: RunFolder, answer: StoredAnswer) -> list[object]:
    """Return the figure and the tables that show the answer on an oscillation.

    The tables contain the damping ratios, the coefficients (if there are any) and all compared models; the last one is
    hidden until the reader clicks on its title.
    """
    v, signal = answer.verdict, answer.signal
    own, quantity = run.unit(signal).displacement, run.quantity(signal)
    unit, recorded = v.damping_ratio[0].unit if v.damping_ratio else "rad", own.of(quantity)
    label = f"{own.quantity_name(quantity)} / {words.divisor(recorded)}"
    draw = partial(figures.answer, answer.arrays, unit, v.damping, label)
    by_laws = "ratio" in answer.arrays
    caption = MEASURED if v.contradicted else CAPTION.format(measured=TWICE if by_laws else ONCE)
    if "free/amplitude" not in answer.arrays:
        caption += UNMEASURED
    parts: list[object] = [run.drawings.add(f"answer-{signal}", caption, draw)]
    parts.append(ratios_table(v.damping_ratio, RATIOS, parts=True))
    if v.coefficients:
        caption = (
            f"Coefficients of {words.model(v.damping)} damping, and parameters of the {words.law(v.restoring)} "
            f"restoring law, with 95 % intervals in brackets. {PARTS_OF_SD}"
        )
        parts.append(coefficients_table(v.coefficients, caption, parts=True))
    rows = [r for r in answer.content.candidates if r.outcome == OK]
    log = {id(r): r.exact if r.log_evidence is None else r.log_evidence for r in rows}
    top, top_exact = max(log.values(), default=0.0), max((r.exact for r in rows), default=0.0)
    compared: dict[str, Callable[[ComparedCandidate], str]] = {
        "damping": lambda r: words.model(r.damping),
        "restoring law": lambda r: words.law(r.restoring),
        "log Bayes factor": lambda r: fmt.fixed_decimals(log[id(r)] - top, 1),
        "log Bayes factor under exact laws": lambda r: fmt.fixed_decimals(r.exact - top_exact, 1),
        f"rms residual, {recorded}": lambda r: "" if r.rms is None else fmt.number(own.scale * r.rms, 3),
    }
    caption = (
        "Every compared model, the most probable first: its log Bayes factors relative to the best "
        "model, in nats (differences of natural-log evidence), and the root mean square (rms) residual of its fit. The "
        "first log Bayes factor, by which the table is sorted, allows for deviations from the laws (for a model "
        "without computed deviations it assumes exact laws); the second one and the fit assume exact laws."
    )
    left_out: dict[str, list[str]] = {}
    for r in answer.content.candidates:
        if r.outcome != OK:
            model = f"{words.model(r.damping)} ({words.law(r.restoring)})"
            left_out.setdefault(r.outcome.rstrip("."), []).append(model)
    for why, models in left_out.items():
        caption += f" Not fitted ({why}): {fmt.listing(models)}."
    table = fmt.Table.of(sorted(rows, key=lambda r: -log[id(r)]), compared, (0, 1), caption)
    return [*parts, collapsible("All damping models that were compared", table)]


def coefficients_table(coefficients: Sequence[Coefficient], caption: str, parts: bool = False) -> fmt.Table:
    """Return a table of coefficients with their 95 % intervals.

    parts: whether to add two columns: the parts of the standard deviation that are due to the noise and to deviations
    from the law.
    """
    columns: dict[str, Callable[[Coefficient], str]] = {
        "parameter": lambda c: words.symbol(c.name).text,
        "value (95 %)": lambda c: fmt.with_interval(c.value, c.low, c.high),
    }
    if parts:
        columns["sd from noise"] = lambda c: fmt.number(c.sd_noise, 2)
        columns["sd from the law"] = lambda c: fmt.number(c.sd_law, 2)
    columns["unit"] = lambda c: words.unit(c.unit)
    return fmt.Table.of(coefficients, columns, (0, len(columns) - 1), caption)


PLUGIN = AnswerSection()
