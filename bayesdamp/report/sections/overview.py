"""Show all records together: verdicts on specimens (objects with several records), damping curves, and a table."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.answer import MOST_COLOURED, overview
from bayesdamp.report.results.run import Row, RunFolder, answers, curve_of, overview_table, specimens
from bayesdamp.report.sections import Section, heading, paragraph, stack
from bayesdamp.report.sections.answer import SHAPES, coefficients_table
from bayesdamp.verdict.parts import decay_table, ratios_table
from bayesdamp.verdict.words import energy_sentences

SPECIMEN_RATIOS = (
    "Equivalent viscous damping ratio and Q = 1/(2 × damping ratio) of the specimen, with 95 % intervals in brackets: "
    "the mean over the records that reach the amplitude."
)
COMMON = (
    "Coefficients of {} damping that all records of the specimen have in common, with 95 % intervals in brackets. In "
    "each record a factor multiplies all of them; its spread from record to record is inferred. Each record has its "
    "own initial conditions, restoring parameters, noise and deviations from the laws."
)
"""Caption of the table of a specimen's coefficients; the name of the damping is inserted."""
POPULATION = (
    "Mean and spread (standard deviation) of each coefficient of {} damping over the {} specimens, with 95 % intervals "
    "in brackets, and the 95 % interval in which the coefficient of one more specimen is expected. The specimens' "
    "coefficients are assumed to have a normal distribution, whose spread few specimens hardly limit."
)
"""Caption of the table of several specimens; the name of the damping and the number of specimens are inserted."""
FEWEST_RECORDS = 3
"""If at least this number of records have an answer, the report has an overview section. With a verdict on a specimen
(a tested object with several records) it has the section for fewer records too."""
TABLE_CAPTION = (
    "One row for each record; click on a header to sort. The row is grey if the record does not decide which damping "
    "it has. Damping ratios are equivalent viscous damping ratios. Deviation from the law: upper limit (95 %) of "
    "the relative deviation of the damping from its law, averaged over the record. Unexplained: the root mean square "
    "of the residual that neither the law nor the noise accounts for, in % of the first amplitude."
)


class OverviewSection(Section):
    """The section with the verdicts on specimens, all damping curves, and a table of the records with links."""

    order = 4
    title = "All records"

    def applies(self, run: RunFolder) -> bool:
        """Return whether the report has this section.

        It has the section in three cases: at least three records have an answer, there is a verdict on a specimen (a
        tested object with several records), or population.csv has rows. A study that states published errors never has
        it.
        """
        several = len(answers(run)) >= FEWEST_RECORDS or bool(specimens(run) or run.population)
        return several and not run.study.get("published")

    def render(self, run: RunFolder) -> str:
        """Return verdicts on specimens, a table of coefficients, a figure of damping curves and a table of records.

        The first table has the mean and the spread of each coefficient over the specimens (population.csv).
        """
        records, verdicts = answers(run), specimens(run)
        parts: list[object] = []
        for v in verdicts:
            title = heading(v.record) if len(verdicts) > 1 else ""
            more = Markup("").join(map(paragraph, (*energy_sentences(v), *v.remarks)))
            block = Markup('<div class="verdict">{}<p class="claim">{}</p>{}</div>')
            parts.append(block.format(title, v.sentence, more))
            if v.decay_rate:
                parts.append(decay_table(v.decay_rate, v.quality_factor_at))
            elif v.damping_ratio:
                parts.append(ratios_table(v.damping_ratio, SPECIMEN_RATIOS))
            if v.coefficients:
                parts.append(coefficients_table(v.coefficients, COMMON.format(words.model(v.damping))))
        if run.population:
            columns: dict[str, Callable[[Row], str]] = {
                "parameter": lambda r: words.symbol(r["parameter"]).text,
                "mean (95 %)": lambda r: fmt.with_interval(r["mean"], r["mean_low"], r["mean_high"]),
                "spread (95 %)": lambda r: fmt.with_interval(r["spread"], r["spread_low"], r["spread_high"]),
                "one more specimen (95 %)": lambda r: fmt.interval(r["next_low"], r["next_high"]),
                "unit": lambda r: words.unit(r["unit"]),
            }
            first = run.population[0]
            caption = POPULATION.format(words.model(first["model"]), first["specimens"])
            table = fmt.Table.of(run.population, columns, (0, 4), caption)
            parts += [heading("Population of the specimens"), table]
        curves = {a.signal: curve for a in records if (curve := curve_of(a)) is not None}
        if curves:
            unit = next(a.verdict.damping_ratio[0].unit for a in records if a.signal in curves)
            caption = (
                "Equivalent viscous damping ratio of each record against amplitude (line), with its 95 % interval "
                f"(band): {SHAPES}."
            )
            if len(curves) > MOST_COLOURED:
                caption += " All records have the same colour."
            parts.append(run.drawings.add("overview", caption, partial(overview, curves, unit)))
        return stack(*parts, replace(overview_table(records), caption=TABLE_CAPTION))


PLUGIN = OverviewSection()
