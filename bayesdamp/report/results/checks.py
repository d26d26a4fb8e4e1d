"""Compare a record's answer with the study's chains, evidence and residuals, and with the truth."""

import math
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
"""Largest change of a coefficient between parts of a record that passes the check, in standard deviations that are
expected by chance."""
PRINTED = 0.001
"""Log odds are compared after probabilities are limited to this and to 1 minus this: the report prints "< 0.001" and
"> 0.999", and larger log odds depend on the tails of the approximations."""
CLEAR_NATS = 3.0
"""A check of an answer fails if log odds from evidence differ from the answer's by more than this, in nats: odds of 20
(conventional)."""
LARGEST_OTHER = 0.03
"""Largest fraction of the posterior probability that another maximum than the mode may have (conventional)."""
MOSTLY_ONE = 1 / (1 + AGREEMENT_SDS**2)
"""The mean of a model with this probability p differs from the mean over all models by at most `AGREEMENT_SDS`, because
the difference is at most √((1 − p)/p) standard deviations of all models together."""
ANSWER_SAMPLER = "smc"
"""The sampler of the answer itself, which therefore cannot check the answer."""
UNLISTED_OUTCOMES = (Status.OK, Status.NOT_APPLICABLE, Status.PRUNED, Status.NOT_SAMPLED)
"""Outcomes that are not listed as failed checks: other sections of the report give their reasons."""


@dataclass(frozen=True)
class Check:
    """A sentence on one check of an answer.

    text: the sentence. fails: whether the checked value contradicts the answer or is unreliable.
    """

    text: str
    fails: bool = False


def sampling_sentence(comparison: Agreement) -> str:
    """Return the sentence whether sequential Monte Carlo confirms, changes or corrects the first verdict.

    The first verdict is from linear approximations. `comparison` contains the agreement of the two.
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
    """Checks of one record's answer against the study's chains, evidence and residuals, and against the truth.

    Only the first repeat of the record is checked.

    Attributes
    ----------
    verdict
        The verdict on the record; None if there is none.
    model
        The study's model with the damping and the restoring law of the answer. If there is no answer, it is the study's
        most probable model. None if the study has no such model.
    coefficient_names
        Names of the damping coefficients of `model`; [] if there is no model.
    exact_only
        Whether the answer allows deviations from the laws, while the chains, evidence and fits assume exact laws.
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

        If no damping law describes the record, nothing is checked, and one sentence says so (if there are chains or
        evidence). Some sentences only add information, such as the true damping of a simulated record.
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
        """Return the rows of a table that belong to `model` on this record."""
        return rows_of(table, signal=self.signal, repeat=self.repeat, model=self.model, **wanted)

    def _samplers(self) -> dict[str, list[Row]]:
        """Return the rows of posteriors.csv for `model`, by sampler.

        Rows without a finite mean, and those of the answer's own sampler (`ANSWER_SAMPLER`), are left out.
        """
        by_sampler: dict[str, list[Row]] = {}
        for row in self._rows(self.run.posteriors):
            if math.isfinite(row["mean"]) and row["sampler"] != ANSWER_SAMPLER:
                by_sampler.setdefault(row["sampler"], []).append(row)
        return by_sampler

    def _samples(self) -> Iterator[Check]:
        """Yield a check of each sampler of `model`, and a failed check if the posterior has another large maximum.

        If a sampler's outcome is neither `ok` nor among `UNLISTED_OUTCOMES`, its check fails and contains the outcome.
        Otherwise the check gives the largest R̂ and the smallest effective sample size. Another maximum is large if it
        has more than `LARGEST_OTHER` of the posterior probability.
        """
        outcomes = {(r["sampler"], r["outcome"]) for r in self._rows(self.run.posteriors)}
        for sampler, outcome in sorted(outcomes):
            if status_of(outcome) not in UNLISTED_OUTCOMES:
                yield Check(f"{_name(sampler)}: {outcome.rstrip('.')}.", fails=True)
        for sampler, rows in self._samplers().items():
            if any(r["outcome"] != OK for r in rows):
                continue
            sizes = [min(r["ess_bulk"], r["ess_tail"]) for r in rows if math.isfinite(r["ess_bulk"])]
            rhats = [r["rhat"] for r in rows if math.isfinite(r["rhat"])]
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
        """Yield checks that compare the damping ratios from the draws of each sampler with the answer's.

        The draws are of `model`. Their median and 95 % interval are compared at each of the answer's amplitudes.
        Samplers that failed, or have no ratio at some amplitude, are left out.
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
        """Yield a failed check for each true coefficient outside the answer's 95 % interval.

        If there is no answer, the interval of the first sampler is used.
        """
        limits = {c.name: (c.low, c.high) for c in self.verdict.coefficients} if self.verdict else {}
        if self.verdict is None:
            rows = next(iter(self._samplers().values()), [])
            limits = {r["parameter"]: (r["q2.5"], r["q97.5"]) for r in rows}
        for name in filter(limits.__contains__, self.coefficient_names):
            true, (low, high) = truth(self.run, self.signal, name), limits[name]
            if math.isfinite(true) and not low <= true <= high:
                symbol = words.symbol(name).text
                text = f"Truth: {symbol} = {fmt.digits(true, n=6)}, which is outside the 95 % interval."
                yield Check(text, fails=True)

    def _evidence(self, ranked: EvidenceRanking | None) -> Iterator[Check]:
        """Yield checks that compare the probabilities from the study's evidence with those of the answer.

        They report evidence that failed or is unreliable, and each method's probability of the answer's damping (a
        failed check if the log odds by the method that counts differ from the answer's by more than `CLEAR_NATS`).
        `ranked` is the result of `rank_models`. There are no such checks if the answer has the only evidence of the
        study.
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
        """Yield a check whether `model` fits, by its residuals, and checks of what is wrong with the fit otherwise.

        These are: coefficients that change between parts of the record, and simulated records that look different from
        this one. There are none for a study that allows deviations, because its fits assume exact laws.
        """
        for row in [] if self.run.under_law else self._rows(self.run.fits)[:1]:
            verdict, name = row["verdict"].rstrip("."), words.model(self.model or "")
            fitting = fitting_of(verdict)
            if verdict and status_of(verdict) not in UNLISTED_OUTCOMES:
                text = f"Residuals: {name} damping{'' if fitting else ':'} {verdict}."
                yield Check(text, fails=fitting is FitStatus.DOES_NOT_FIT and not self.exact_only)
            if math.isfinite(row["window_spread"]) and row["window_spread"] > WINDOW_SPREAD:
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
    """Return the log odds (nats) of a probability, which is first limited to the range that is printed in full."""
    limited = min(max(probability, PRINTED), 1 - PRINTED)
    return math.log(limited / (1 - limited))


def _name(method: str) -> str:
    """Return a method's name in words for the beginning of a sentence. The name "emcee" is not capitalised."""
    name = words.method(method)
    return name if method == "emcee" else name[:1].upper() + name[1:]


def _same_sum(dampings: Iterable[str], damping: str) -> str | None:
    """Return the first damping sum in `dampings` with the same terms as `damping`; None if there is none."""
    terms = set(damping.split("+"))
    return next((d for d in dampings if set(d.split("+")) == terms), None)
