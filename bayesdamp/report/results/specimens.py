"""What the joint fits and the population say, in sentences."""

from __future__ import annotations

from collections.abc import Mapping

from bayesdamp import formatting as fmt
from bayesdamp.outcomes import Fitting, fitting_of
from bayesdamp.report import words
from bayesdamp.report.results.run import Run, rows_of
from bayesdamp.store import CellResult
from bayesdamp.store.contents.many import JointContent, PopulationContent, Weighing
from bayesdamp.types import OK, candidate_parts, summed
from bayesdamp.verdict.thresholds import CAP, DECIDED

WORTH = 0.01
"""Probability from which a form of damping is named that the study does not compare."""


def joint_cells(run: Run) -> dict[str, CellResult]:
    """The joint fit of each specimen with several records, by its name."""
    return {cell.place.record: cell for cell in run.cells("joint")}


def population_cell(run: Run) -> CellResult | None:
    """The population over specimens, where there are several."""
    return run.cell("population", "specimens")


def sentences(run: Run) -> list[str]:
    """One for each specimen with several records, and one for the population over specimens."""
    found = [f"{name}: {joint_sentence(run, cell)}" for name, cell in joint_cells(run).items()]
    cell = population_cell(run)
    return found + ([population_sentence(cell)] if cell is not None else [])


ASSUMED = {
    "none": "if every law held exactly",
    "law": "laws holding approximately, each record with deviations of its own",
}
"""Under which assumption a joint fit or a population is."""


def joint_sentence(run: Run, cell: CellResult) -> str:
    """Return what a joint fit says: which damping, how large, how much records differ, and whether it fits them."""
    joint = JointContent.maybe(cell)
    if joint is None:
        return f"no joint fit: {cell.outcome}."
    row = joint.candidates[joint.best]
    text = f"{len(joint.records)} records together, {ASSUMED[joint.deviation]}: damping is {_named(joint)}"
    if row.summary:
        text += f"; {fmt.listing(f'{words.symbol(n).text} = {size(row, n)}' for n in row.summary)}"
    text += f"; {spread_clause(joint)}"
    if row.outcome != OK:
        text += f"; {row.outcome}"
    # Where laws may hold approximately each record's own deviation takes what an exact law does not fit.
    worse = misfits(run, joint) if joint.deviation == "none" else []
    return f"{text}; it does not fit {fmt.listing(worse)}." if worse else f"{text}."


def spread_clause(joint: JointContent) -> str:
    """Return how much the damping differs from record to record, and whether the records agree."""
    median, low, high = (fmt.number(100 * joint.spread[q], 2) for q in ("median", "q2.5", "q97.5"))
    by = f"from record to record by {median} % (standard deviation; 95 %: {low} to {high} %)"
    if joint.differ:
        return f"the records differ in the size of their damping, so that each has its own: it varies {by}"
    if joint.agree:
        return f"the records agree with one damping, which varies {by}"
    return f"the records are compatible with one damping, which varies {by}"


def _named(joint: JointContent) -> str:
    """The damping with its probability, summed over restoring laws, and the law with its own."""
    probabilities = {c: row.probability for c, row in joint.candidates.items()}
    damping, law = candidate_parts(joint.best)
    p = summed(probabilities)[damping]
    sure = "" if p >= DECIDED else "most likely "
    text = f"{sure}{words.model(damping)}, with probability {capped(p)}"
    laws = summed(probabilities, 1)
    if len(laws) > 1:
        text += f", the restoring law {words.law(law)}, with probability {capped(laws[law])}"
    others = [f"{words.model(n)} {capped(q)}" for n, q in joint.others.items() if q >= WORTH]
    return f"{text} (also weighed: {fmt.listing(others)})" if others else text


def misfits(run: Run, joint: JointContent) -> list[str]:
    """The records that the best joint candidate does not fit by itself."""
    found = []
    for label, (signal, repeat) in zip(joint.records, joint.members):
        rows = rows_of(run.fits, signal=signal, repeat=repeat, model=joint.best)
        if rows and fitting_of(rows[0]["verdict"]) is Fitting.DOES_NOT_FIT:
            found.append(label)
    return found


def capped(probability: float) -> str:
    """Return a probability in words; of measured records no more is claimed than in the answers."""
    return f"> {CAP:g}" if probability > CAP else fmt.probability(probability)


def size(row: Weighing, name: str) -> str:
    """A parameter of a candidate with its standard deviation and unit."""
    one = row.summary[name]
    return f"{fmt.with_error(one['mean'], one['sd'])} {words.unit(row.units[name])}"


def over(one: Mapping[str, float], unit: str) -> str:
    """The population's mean or spread with its 95 % interval."""
    return f"{fmt.number(one['median'], 3)} {fmt.interval(one['q2.5'], one['q97.5'])} {words.unit(unit)}"


def population_sentence(cell: CellResult) -> str:
    """What the population over specimens says: mean and spread of each coefficient, and a warning with them."""
    found = PopulationContent.maybe(cell)
    if found is None:
        return f"Over the specimens: {cell.outcome}."
    parts = [
        f"{words.symbol(n).text} has the mean {over(p.mean, found.units[n])} and the spread "
        f"{over(p.spread, found.units[n])}"
        for n, p in found.populations.items()
    ]
    text = f"Over {len(found.specimens)} specimens, all taken as {words.model(found.best)}, "
    text += f"{ASSUMED[found.deviation]}: "
    text += fmt.listing(parts)
    return f"{text}; {cell.outcome}." if cell.outcome != OK else f"{text}."
