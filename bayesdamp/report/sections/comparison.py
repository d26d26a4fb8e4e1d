"""Show the errors and times of all estimators on simulated records."""

import math
from collections.abc import Callable
from functools import partial

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.results.estimators import STAGES, category_of, compare_estimators, printed_error
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.sections import Section, stack

ERRORS = (
    "Absolute error of the damping coefficients that each method estimates on each signal, in % of the true values "
    "(the root mean square over several coefficients or repeats); the mean of these errors over the signals; and the "
    "published error if the study states it. *: the method reports that this value is unreliable; the tables of the "
    "section on the estimators give the reason."
)
TIMES = (
    "Computing time of each method for all signals of the table of errors together, including the compilation of its "
    "code if that was necessary, and the published time if the study states it."
)
"""`ERRORS` and `TIMES` are the captions of the two tables of this section."""


class ComparisonSection(Section):
    """The section with errors and computing times of all estimators, under the true model of each simulated record."""

    order = 35
    title = "Comparison of the estimators"

    def applies(self, run: RunFolder) -> bool:
        """Return whether there are errors, and either several methods and several signals, or published errors."""
        if not run.estimates:
            return False
        comparison = compare_estimators(run)
        several = len(comparison.signals) > 1 and len(comparison.methods) > 1
        return comparison.errors.notna().any(axis=None) and (several or comparison.published.size > 0)

    def render(self, run: RunFolder) -> str:
        """Return two tables as HTML: the errors and the computing times of each estimator."""
        comparison = compare_estimators(run)
        published = comparison.published

        def error_of(method: str, signal: str, stage: str) -> str:
            error = comparison.errors.at[method, (signal, stage)]
            doubted = (method, signal, stage) in comparison.doubted and math.isfinite(error)
            return fmt.number(error, 2) + "*" * doubted

        errors: dict[str, Callable[[str], str]] = {"method": words.method, "category": category_of}
        for signal in comparison.signals:
            for stage in STAGES:
                errors[f"{signal}, {words.stage(stage)}"] = partial(error_of, signal=signal, stage=stage)
            if published.size:
                errors[f"{signal}, published"] = lambda m, s=signal: published.at[m, s] or fmt.NONE
        times: dict[str, Callable[[str], str]] = {"method": words.method}
        for stage in STAGES:
            name, means = words.stage(stage), comparison.at_stage(stage).mean(axis=1)
            errors[f"mean, {name}"] = lambda m, means=means: fmt.number(means[m], 2)
            times[name] = lambda m, stage=stage: fmt.duration(comparison.seconds.at[m, stage])
        if published.size:
            printed = published.map(printed_error).mean(axis=1)
            errors["mean, published"] = lambda m: fmt.number(printed[m], 2)
            times["published"] = lambda m: comparison.times.get(m, fmt.NONE)
        return stack(
            fmt.Table.of(comparison.methods, errors, (0, 1), ERRORS),
            fmt.Table.of(comparison.methods, times, (0,), TIMES),
        )


PLUGIN = ComparisonSection()
