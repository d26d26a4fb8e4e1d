"""Show the errors of the estimators against noise, sampling and length."""

from functools import partial

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.estimators import LOWEST_ERROR, sweep
from bayesdamp.report.results.estimators import FACTORS, error_series, sort_by_category
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.sections import Section, heading, stack


class SweepsSection(Section):
    """The section with a figure for each series of simulated signals that differ only in noise, sampling or length."""

    order = 37
    title = "Errors against noise, sampling and length"

    def applies(self, run: RunFolder) -> bool:
        """Return whether the run has a series: at least three signals that differ only in noise, sampling or length."""
        return len(run.signals) >= 3 and bool(run.estimates) and bool(error_series(run))

    def render(self, run: RunFolder) -> str:
        """Return a figure of the estimators' errors for each series of signals."""
        parts: list[object] = []
        for along in error_series(run):
            model, methods = words.model(along.model), sort_by_category(along.errors.index.unique(0))
            counts = sorted(along.repeats.unique())
            over = f", over {fmt.listing(map(str, counts), 'or')} repeats" if counts else ""
            others = fmt.listing([factor for factor in FACTORS if factor != along.factor])
            caption = (
                f"Root mean square error of the coefficients of {model} damping, in % of the true values{over}, "
                f"against the {along.factor} of simulated records; {others} are constant. Left: the methods' own "
                "estimates; right: the trajectory fits that start from them. Dashed: the Cramér–Rao bound, the "
                "smallest standard error of an unbiased estimate. An error below it means that the method is biased, "
                "or uses information from outside the record. The legend gives the number of repeats of each method. "
                f"Errors below {fmt.number(LOWEST_ERROR, 2)} % are drawn at this value, and a noise of 0 at the left "
                "edge."
            )
            draw = partial(sweep, along, methods)
            figure = run.drawings.add(f"sweep-{along.model}-{along.factor}", caption, draw)
            parts += [heading(f"{model}: errors against the {along.factor}"), figure]
        return stack(*parts)


PLUGIN = SweepsSection()
