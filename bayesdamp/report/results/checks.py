"""Compare the answer on a record with the study's posterior draws, evidence and residuals, and with the true values."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.results.estimators import true_models
from bayesdamp.report.results.run import (
    EvidenceRanking,
    Row,
    RunFolder,
    answer_of,
    coefficients,
    damping_of,
    models_by_rank,
    rank_models,
    rows_of,
    truth,
)
from bayesdamp.store.results import ModeContent, PosteriorContent
from bayesdamp.types import OK, P_LIMIT, FitStatus, Status, candidate_parts, fitting_of, status_of
from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.specimen import Agreement, agreement, worst_agreement
from bayesdamp.verdict.thresholds import AGREEMENT_SDS

WINDOW_SPREAD = 3.0
"""A check fails if a damping coefficient from half of the record differs from that of the whole record by more than
this, in units of the standard deviation that is expected by chance."""
PRINTED = 0.001
"""Smallest probability that the report prints as a number; it prints "< 0.001" below it and "> 0.999" above 1 minus it.
Probabilities are limited to this range before their log odds are compared, because larger log odds depend on the tails
of the approximations."""
CLEAR_NATS = 3.0
"""A check fails if the log odds of the answer's damping, computed from the study's evidence, differ from those in the
answer by more than this, in nats; 3 nats are odds of 20 (conventional)."""
LARGEST_OTHER = 0.03
"""A check fails if a maximum of the posterior other than the highest one has more than this fraction of the posterior
probability (conventional)."""
MOSTLY_ONE = 1 / (1 + AGREEMENT_SDS**2)
"""If a model has at least this probability p, its mean of a quantity differs by at most `AGREEMENT_SDS` standard
deviations from the mean over all models, because the difference is at most √((1 − p)/p) of them. (The standard
deviation is that of the mixture of all models.)"""
ANSWER_SAMPLER = "smc"
"""Name of the sampler (sequential Monte Carlo) that computes the answer itself. Its results cannot check the answer."""
UNLISTED_OUTCOMES = (Status.OK, Status.NOT_APPLICABLE, Status.PRUNED, Status.NOT_SAMPLED)
"""Outcomes that are not listed as failed checks: other sections of the report give their reasons."""


@dataclass(frozen=True)
class Check:
    """The result of one check of the answer on a record, as a sentence for the report.

    text: the sentence. fails: whether the checked value contradicts the answer or is unreliable.
    """

    text: str
    fails: bool = False


def sampling_sentence(comparison: Agreement) -> str:
    """Return a sentence that says whether the verdict from sampling confirms, changes or corrects the first verdict.

    The first verdict is from linear approximations of the models, the second from sequential Monte Carlo. `comparison`
    states how well they agree.
    """
    moved = f"{max(comparison.moved, 0.1):.1f} standard deviations"
    if comparison.confirms:
        return (
            "Sampling (sequential Monte Carlo) confirms the result of linear approximations: the damping ratios differ "
            f"by at most {moved}."
        )
    if comparison.same:
        return f"Sampling (sequential Monte Carlo) changes damping ratios of linear approximations by up to {moved}."
    return "Sampling (sequential Monte Carlo) corrects the result of linear approximations."


def sampling_checks(run: RunFolder, signal: str) -> list[Check]:
    """Return a check that compares the answer from sequential Monte Carlo with that from linear approximations.

    This check only informs and never fails. The list is empty if nothing was sampled, or if the record is not a free
    decay or no law describes it.
    """
    first, last = (answer_of(run, signal, kinds) for kinds in (("answer",), ("sampled",)))
    if first is None or last is None or first.verdict.grade is Grade.NO_FREE_DECAY or last.verdict.law_free:
        return []
    comparison = agreement(first.verdict, last.verdict)
    before = "" if comparison.same else f" These alone gave: {first.verdict.sentence}"
    return [Check(sampling_sentence(comparison) + before)]


class RecordChecks:
    """Checks of the answer on one record against the study's draws, evidence and residuals, and the true values.

    The draws are from the chains of the study's samplers. Only the first repeat of the record is checked.

    Attributes
    ----------
    verdict
        The verdict on the record, with amplitudes in the unit of its file; None if there is none.
    model
        Name of the study's model that has the damping and the restoring law of the answer. If there is no answer, it is
        the study's most probable model. None if the study has no such model.
    coefficient_names
        Names of the damping coefficients of `model`; [] if there is no model.
    exact_only
        Whether the answer allows deviations from the damping and restoring laws, while the study's chains, evidence and
        fits assume that the laws hold exactly.
    """

    def __init__(self, run: RunFolder, signal: str) -> None:
        self.run, self.signal, self.repeat = run, signal, run.repeats(signal)[0]
        answer = answer_of(run, signal)
        self.verdict = v = answer.verdict if answer else None
        candidates = models_by_rank(run, signal, self.repeat)
        if v is not None:
            parts = [(m, *candidate_parts(m)) for m in candidates]
            candidates = [m for m, d, law in parts if law in ("", v.restoring) and _same_sum([d], v.damping)]
        self.model = next(iter(candidates), None)
        self.coefficient_names = coefficients(run, self.model) if self.model else []
        self.exact_only = v is not None and v.deviation is not None and not run.under_law

    def all(self) -> list[Check]:
        """Return all checks, the failed ones first. There are none for an envelope.

        If no damping law describes the record, nothing is checked; if there are chains or evidence, one sentence says
        this. Some sentences only add information, such as the true damping of a simulated record.
        """
        v, evidence = self.verdict, rank_models(self.run, self.signal, self.repeat)
        if v is not None and v.quantity == "envelope":
            return []
        has_tables = bool(self._samplers()) or (evidence is not None and evidence.method != ANSWER_SAMPLER)
        if v is not None and v.law_free:
            text = (
                "No damping law describes this record. Chains and evidence assume a law, so they are not compared with "
                "the answer."
            )
            return [Check(text)] if has_tables else []
        checks = [*self._samples(), *self._ratios(), *self._truth()]
        checks += [*self._evidence(evidence), *self._residuals()]
        true = true_models(self.run).get(self.signal)
        if true is not None and v is not None and v.damping:
            text = f"Truth: the record was simulated with {words.model(true)} damping"
            if _same_sum([true], v.damping) is None:
                share = next((r.probability for r in v.rivals if _same_sum([true], r.damping)), 0.0)
                text = f"{text}, to which the answer gives the probability {fmt.probability(share)}."
                checks.append(Check(text, fails=True))
            elif v.decided:
                checks.append(Check(f"{text}, as the answer says."))
            else:
                share = fmt.probability(v.probability)
                checks.append(Check(f"{text}, the most probable in the answer (probability {share})."))
        if self.exact_only and has_tables:
            text = (
                "Chains, evidence and residual checks assume that the laws hold exactly. The answer does not assume "
                "this, so quote its intervals."
            )
            checks.append(Check(text))
        return sorted(checks, key=lambda check: not check.fails)

    def _rows(self, table: Iterable[Row], **wanted: object) -> list[Row]:
        """Return the rows of a table for `self.model` on this record. `wanted`: required values of further columns."""
        return rows_of(table, signal=self.signal, repeat=self.repeat, model=self.model, **wanted)

    def _samplers(self) -> dict[str, list[Row]]:
        """Return the rows of posteriors.csv for the checked model (`self.model`), by sampler.

        Rows without a finite mean, and those of the sampler that computed the answer (`ANSWER_SAMPLER`), are left out.
        """
        by_sampler: dict[str, list[Row]] = {}
        for row in self._rows(self.run.posteriors):
            if np.isfinite(row["mean"]) and row["sampler"] != ANSWER_SAMPLER:
                by_sampler.setdefault(row["sampler"], []).append(row)
        return by_sampler

    def _samples(self) -> Iterator[Check]:
        """Yield a check of each sampler of `model`, and a failed check if the posterior has a second large maximum.

        If a sampler's outcome is neither `ok` nor among `UNLISTED_OUTCOMES`, its check fails and contains the outcome.
        Otherwise the check gives the largest R̂ and the smallest effective sample size. A second maximum is large if it
        has more than `LARGEST_OTHER` of the posterior probability.
        """
        outcomes = {(r["sampler"], r["outcome"]) for r in self._rows(self.run.posteriors)}
        for sampler, outcome in sorted(outcomes):
            if status_of(outcome) not in UNLISTED_OUTCOMES:
                yield Check(f"{_name(sampler)}: {outcome.rstrip('.')}.", fails=True)
        for sampler, rows in self._samplers().items():
            if any(r["outcome"] != OK for r in rows):
                continue
            sizes = [min(r["ess_bulk"], r["ess_tail"]) for r in rows if np.isfinite(r["ess_bulk"])]
            rhats = [r["rhat"] for r in rows if np.isfinite(r["rhat"])]
            if sizes and rhats:
                text = f"R̂ at most {max(rhats):.3f}, effective sample size at least {min(sizes):,.0f}"
                yield Check(f"{_name(sampler)} converged: {text}.")
        result = self.run.task_result("mode", self.signal, self.repeat, self.model or "")
        mode = ModeContent.maybe(result) if result and result.outcome == OK else None
        share = max(mode.shares[1:], default=0.0) if mode else 0.0
        if share > LARGEST_OTHER:
            yield Check(
                f"Another maximum of {words.model(self.model or '')} has {fmt.percentage(share)} % of the posterior "
                "probability; chains and evidence may not include it.",
                fails=True,
            )

    def _ratios(self) -> Iterator[Check]:
        """Yield a check for each sampler that compares its damping ratios with those of the answer.

        The ratios are from the sampler's draws of `model`. Their medians and 95 % intervals are compared at each of the
        answer's amplitudes. Samplers that failed, or have no ratio at one of the amplitudes, are left out.
        """
        for sampler, rows in self._samplers().items():
            result = self.run.task_result("posterior", self.signal, self.repeat, self.model or "", sampler)
            content = PosteriorContent.maybe(result)
            ratios = [(r.value, r.low, r.high) for r in content.ratios] if content else []
            is_complete = self.verdict is not None and len(ratios) == len(self.verdict.damping_ratio) > 0
            if is_complete and np.isfinite(ratios).all() and all(r["outcome"] == OK for r in rows):
                yield self._check_ratios(_name(sampler), ratios)

    def _check_ratios(self, name: str, ratios: list[tuple[float, float, float]]) -> Check:
        """Return a check that compares a sampler's damping ratios with those of the answer.

        ratios: value and both ends of the 95 % interval, at each amplitude of the answer. The check is made at the
        amplitude with the worst agreement. It fails if the ratio differs by at least `AGREEMENT_SDS` standard
        deviations of the answer, or if its interval is at least `WIDTHS_AGREE` times as wide. It never fails in two
        cases: if `exact_only` is true, or if the sampled model has a probability below `MOSTLY_ONE` in the answer,
        because the answer is averaged over all models.
        """
        v = self.verdict
        assert v is not None

        def ratio_at(i: int) -> str:
            """Return the damping ratio from the chains at the i-th amplitude, as text."""
            place = v.damping_ratio[i]
            size = fmt.with_interval(*ratios[i], " %", 100)
            return f"{size} at {fmt.digits(place.amplitude, n=2)} {place.unit}"

        worst, middle = worst_agreement(v, ratios), ratio_at(len(ratios) // 2)
        if self.exact_only:
            return Check(
                f"{name} assumes that laws hold exactly and gives a damping ratio of {middle}; the answer allows "
                "deviations."
            )
        if worst.confirms:
            return Check(f"{name} confirms the damping ratio: {middle}.")
        if v.probability < MOSTLY_ONE:
            return Check(
                f"{name} sampled {words.model(v.damping)} damping alone, which has probability "
                f"{fmt.probability(v.probability)} in the answer, and gives a damping ratio of {middle}."
            )
        largest = ratio_at(next(i for i, r in enumerate(v.damping_ratio) if r.amplitude == worst.amplitude))
        width = f"an interval {worst.wider:.1f} times as wide"
        if worst.moved >= AGREEMENT_SDS:
            text = (
                f"{name} contradicts the damping ratio: it gives {largest}, which differs by {worst.moved:.1f} of "
                f"the answer's standard deviations, with {width}."
            )
            return Check(text, fails=True)
        text = f"{name} agrees with the damping ratio but gives {width}: {largest}."
        return Check(text, fails=worst.wider > 1)

    def _truth(self) -> Iterator[Check]:
        """Yield a failed check for each damping coefficient whose true value is outside the answer's 95 % interval.

        If there is no answer, the interval of the first sampler is used.
        """
        limits = {c.name: (c.low, c.high) for c in self.verdict.coefficients} if self.verdict else {}
        if self.verdict is None:
            rows = next(iter(self._samplers().values()), [])
            limits = {r["parameter"]: (r["q2.5"], r["q97.5"]) for r in rows}
        for name in filter(limits.__contains__, self.coefficient_names):
            true, (low, high) = truth(self.run, self.signal, name), limits[name]
            if np.isfinite(true) and not low <= true <= high:
                symbol = words.symbol(name).text
                text = f"Truth: {symbol} = {fmt.digits(true, n=6)}, which is outside the 95 % interval."
                yield Check(text, fails=True)

    def _evidence(self, ranked: EvidenceRanking | None) -> Iterator[Check]:
        """Yield checks that compare the probabilities from the study's evidence with those of the answer.

        Evidence that is missing or unreliable gives a failed check. Another check states, for each evidence method, the
        probability of the answer's damping. It fails if the log odds by the method of the ranking differ from those of
        the answer by more than `CLEAR_NATS`. `ranked` is the result of `rank_models`. There are no such checks if the
        study has no other evidence than that of the answer.
        """
        if ranked is None or ranked.method == ANSWER_SAMPLER:
            return
        v = self.verdict
        # Evidence values that failed or are unreliable.
        for row in rows_of(self.run.evidence, signal=self.signal, repeat=self.repeat):
            counts = ranked.method != "combined" or row["method"] == "combined"
            if counts and status_of(row["outcome"]) not in UNLISTED_OUTCOMES:
                which = f"{words.model(row['model'])} ({words.method(row['method'])})"
                reason = row["outcome"].rstrip(".")
                yield Check(f"The evidence of {which} is missing or unreliable: {reason}.", fails=True)
        if len({damping_of(row) for row in ranked.rows}) < 2:
            yield Check("No other damping model was compared.")
            return
        methods = dict.fromkeys([ranked.method, *(m for m in ranked.shares if m != ANSWER_SAMPLER)])
        shares = {m: ranked.shares[m] for m in methods if len(ranked.shares[m]) == len(ranked.dampings)}
        # The probability of the answer's damping by each method. The answer's own probability is rescaled to the
        # dampings that the study compares.
        named = _same_sum(ranked.dampings, v.damping) if v else next(iter(ranked.dampings))
        if named is not None:
            by = fmt.listing(f"{fmt.probability(p[named])} by {words.method(m)}" for m, p in shares.items())
            answer, apart = "", 0.0
            if v is not None:
                each = [(v.damping, v.probability), *((r.damping, r.probability) for r in v.rivals)]
                total = sum(p for damping, p in each if _same_sum(ranked.dampings, damping) is not None)
                if total > 0:
                    own = v.probability / total
                    answer = f"; the answer gives {fmt.probability(own)}"
                    if ranked.method in shares:
                        apart = abs(_log_odds(shares[ranked.method][named]) - _log_odds(own))
            contradicts = apart > CLEAR_NATS and not self.exact_only
            if contradicts:
                answer = f"{answer}, and the log odds differ by {apart:.1f} nats"
            yield Check(
                f"Probability of {words.model(named)} damping among the damping models of the study: "
                f"{by}{answer}.",
                fails=contradicts,
            )

    def _residuals(self) -> Iterator[Check]:
        """Yield a check that states whether `model` fits the record, from the residuals, and failed checks of the fit.

        These are for coefficients that change between parts of the record, and for records simulated from the model
        that look different from this one. If the study's samplers allow deviations from the laws, there are no checks,
        because the fits assume exact laws.
        """
        for row in [] if self.run.under_law else self._rows(self.run.fits)[:1]:
            verdict, name = row["verdict"].rstrip("."), words.model(self.model or "")
            fitting = fitting_of(verdict)
            if verdict and status_of(verdict) not in UNLISTED_OUTCOMES:
                text = f"Residuals: {name} damping{'' if fitting else ':'} {verdict}."
                yield Check(text, fails=fitting is FitStatus.DOES_NOT_FIT and not self.exact_only)
            if np.isfinite(row["window_spread"]) and row["window_spread"] > WINDOW_SPREAD:
                text = (
                    "Between a half of the record and the whole record, a damping coefficient changes by up to "
                    f"{fmt.number(row['window_spread'], 2)} times the standard deviation that is expected by chance; "
                    f"above {WINDOW_SPREAD:g} the model is doubtful."
                )
                yield Check(text, fails=True)
            if row["predictive_p"] < P_LIMIT:
                p = fmt.number(row["predictive_p"], 2)
                text = f"Records simulated from the model look different from this one (predictive p {p})."
                yield Check(text, fails=not self.exact_only)


def _log_odds(probability: float) -> float:
    """Return the log odds (nats) of a probability, after limiting it to the range from `PRINTED` to 1 − `PRINTED`."""
    limited = min(max(probability, PRINTED), 1 - PRINTED)
    return float(np.log(limited / (1 - limited)))


def _name(method: str) -> str:
    """Return the name of a method in words, capitalised for the beginning of a sentence (except "emcee")."""
    name = words.method(method)
    return name if method == "emcee" else name[:1].upper() + name[1:]


def _same_sum(dampings: Iterable[str], damping: str) -> str | None:
    """Return the first damping sum in `dampings` with the same terms (joined by +) as `damping`, or None."""
    terms = set(damping.split("+"))
    return next((d for d in dampings if set(d.split("+")) == terms), None)
