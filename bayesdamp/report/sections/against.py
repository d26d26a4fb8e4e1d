"""The estimators against the posterior, as one picture."""

from __future__ import annotations

import math
from collections.abc import Sequence

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report.figures._panels import ABREAST
from bayesdamp.report.figures.estimators import against
from bayesdamp.report.html import paragraph, stack
from bayesdamp.report.results.estimates import CoefficientEstimates, coefficient_estimates
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._section import Section


class AgainstSection(Section):
    """One panel a coefficient. A study with published figures has the picture beside its tables."""

    order = 16
    name = "against"
    title = "The estimators against the posterior"

    def applies(self, run: Run) -> bool:
        """Where there is a posterior, and no published tables, which bring the picture with them."""
        return not run.study.get("published") and any(one.posterior for one in coefficient_estimates(run))

    def render(self, run: Run) -> str:
        """A sentence and the picture."""
        found = coefficient_estimates(run)
        return stack(paragraph(inside(found)), picture(run, found))


def inside(found: Sequence[CoefficientEstimates]) -> str:
    """How many of the estimates lie in the interval, in a sentence."""
    said = []
    for name, values in (
        ("own estimates", _values(found, "own")),
        ("trajectory fits", _values(found, "refined")),
    ):
        if values:
            count = sum(low <= value <= high for value, low, high in values)
            said.append(f"{count} of the {len(values)} {name}")
    return f"{fmt.listing(said)} lie in the posterior's 95 % interval." if said else ""


def _values(found: Sequence[CoefficientEstimates], stage: str) -> list[tuple[float, float, float]]:
    return [
        (value, *one.posterior)
        for one in found
        if one.posterior is not None and one.source == one.signal
        for value in getattr(one, stage).values()
    ]


def picture(run: Run, found: Sequence[CoefficientEstimates], name: str = "against", lead: str = "") -> Markup:
    """Draw the estimates against the posterior. lead: the beginning of the caption."""
    said = [
        f"{lead}What each method found by itself (open) and after the trajectory fit that starts there (filled)."
    ]
    if any(one.posterior for one in found):
        said.append(
            "An estimate inside the shaded interval is as good as the record allows; outside it, the method adds an "
            "error of its own."
        )
    borrowed = {one.signal: one.source for one in found if one.posterior and one.source != one.signal}
    if borrowed:
        pairs = [f"{signal}: that of {source}" for signal, source in borrowed.items()]
        said.append(f"A record without noise has no posterior and shows another's ({', '.join(pairs)}).")
    if any(one.published for one in found):
        said.append("Published errors have no sign: a tick on each side of the truth.")
    if any(math.isfinite(value) for one in found for value in one.own.values()):
        said.append("Arrows: off the axis.")
    abreast = min(ABREAST, _in_a_row(found))
    return run.drawings.add(
        name, " ".join(said), lambda: against(found, abreast), narrow=lambda: against(found, 1)
    )


def _in_a_row(found: Sequence[CoefficientEstimates]) -> int:
    """So many that signals with published figures fill rows of their own."""
    printed = sum(bool(one.published) for one in found)
    return printed if 0 < printed < len(found) else len(found)


PLUGIN = AgainstSection()
