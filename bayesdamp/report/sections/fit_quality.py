"""Show how well each model fits each record."""

from collections.abc import Callable

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.results.run import Row, RunFolder, models_by_rank, rms_of, rows_of
from bayesdamp.report.sections import SignalSection, paragraph, repeat_column, stack

CAPTION = "Checks of the fit of each model at its posterior mode. The verdict says whether the model fits."
_EXACT = (
    "All these fits assume that the laws hold exactly. The chains and the evidence of this study allow deviations from "
    "the laws, which account for systematic residuals of these fits."
)


class FitQualitySection(SignalSection):
    """The section with the checks of each fit, as in fits.csv."""

    order = 70
    title = "Quality of the fits"
    lead = (
        "The autocorrelation of the residual at lag one shows whether neighbouring samples are independent, as for "
        "white noise (then it is near 0). The stability over sub-records is the largest change of a damping "
        "coefficient when only half of the record is used, in units of the standard deviation that is expected by "
        "chance. Up to about three it can be chance; above that, the accuracy is limited by this change and not by "
        "the width of the posterior. The predictive p is the fraction of simulated white noise that is as strongly "
        "autocorrelated as the residual, averaged over the posterior; a small value means that structure remains in "
        "the residual."
    )

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether models were fitted to a signal; False if the run contains only answers (`only_answered`)."""
        fitted = any(r["signal"] == signal for r in run.fits) or any(run.task_results("mode", signal))
        return fitted and not run.only_answered

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return a table with the checks of each model's fit to a signal."""
        repeats = run.repeats(signal)
        ranked = models_by_rank(run, signal, repeats[0])
        parts: list[object] = [paragraph(_EXACT)] if run.under_law else []
        checks: dict[str, Callable[[Row], str]] = {
            **repeat_column(repeats),
            "model": lambda r: words.model(r["model"]),
            "rms residual": rms_of,
            "autocorrelation": lambda r: fmt.fixed_decimals(r["residual_autocorrelation"], 2),
            "stability over sub-records": lambda r: fmt.number(r["window_spread"], 2),
            "predictive p": lambda r: fmt.number(r["predictive_p"], 2),
            "verdict": lambda r: r["verdict"] or fmt.NONE,
        }
        fits = sorted(rows_of(run.fits, signal=signal), key=lambda r: (r["repeat"], ranked.index(r["model"])))
        parts.append(fmt.Table.of(fits, checks, (len(checks) - 6, len(checks) - 1), CAPTION))
        return stack(*parts)


PLUGIN = FitQualitySection()
