"""Compare a record's answer with the study's chains, evidence, residuals and estimators, and with the truth."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from bayesdamp import formatting as fmt
from bayesdamp.outcomes import P_LIMIT, FitStatus, Status, fitting_of, status_of
from bayesdamp.report import words
from bayesdamp.report.results.estimators import true_models
from bayesdamp.report.results.run import (
    EvidenceRanking,
    Row,
    RunFolder,
    answer_of,
    coefficients,
    damping_of,
    mode_of,
    models_by_rank,
    probability_by_width,
    rank_models,
    rows_of,
    truth,
)
from bayesdamp.store.contents import CLEAR_NATS, PosteriorContent
from bayesdamp.types import NORMAL_95, OK, candidate_parts
from bayesdamp.verdict.agreement import Agreement, agreement, worst_agreement
from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.thresholds import AGREEMENT_SDS, WIDTH_HOLDS
from bayesdamp.verdict.types import Verdict

WINDOW_SPREAD = 3.0
"""Largest change of a coefficient between parts of a record that passes the check, in standard deviations that are
expected by chance."""
PRINTED = 0.001
"""Log odds are compared after probabilities are limited to this and to 1 minus this: the report prints "< 0.001" and
"> 0.999", and larger log odds depend on the tails of the approximations."""
LARGEST_OTHER = 0.03
"""Largest fraction of the posterior probability that another maximum than the mode may have (conventional)."""
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
    """Return the text that is printed before a verdict from sequential Monte Carlo.

    It says whether this verdict confirms, changes or corrects the first verdict, which is from linear approximations
    and was printed earlier. `comparison` contains the agreement of the two.
    """
    if comparison.confirms:
        return "Sampling (sequential Monte Carlo) confirms this result. The report shows the result from sampling:"
    if comparison.same:
        moved = f"{comparison.moved:.1f} standard deviations"
        return f"Sampling (sequential Monte Carlo) changes the damping ratio by {moved}:"
    return "Sampling (sequential Monte Carlo) corrects this result:"


def sampling_checks(run: RunFolder, signal: str) -> list[Check]:
    """Return a check that compares the answer from sequential Monte Carlo with that from linear approximations.

    This check only informs and never fails. The list is empty without sampling, or if the record is not a free decay or
    no law describes it.
    """
    first, last = (answer_of(run, signal, kinds) for kinds in (("answer",), ("sampled",)))
    if first is None or last is None or first.verdict.grade is Grade.NO_FREE_DECAY or last.verdict.law_free:
        return []
    comparison = agreement(first.verdict, last.verdict)
    text = f"This result is from sequential Monte Carlo; linear approximations alone gave: {first.verdict.sentence}"
    if comparison.confirms:
        text = (
            "Sequential Monte Carlo gives this result and confirms that of linear approximations: the damping ratios "
            f"differ by at most {max(comparison.moved, 0.1):.1f} standard deviations."
        )
    elif comparison.same:
        text = (
            "This result is from sequential Monte Carlo; the damping ratios from linear approximations differ by up to "
            f"{comparison.moved:.1f} standard deviations."
        )
    return [Check(text)]


class RecordChecks:
    """Checks of one record's answer against the study's chains, evidence, residuals and trajectory fits.

    Only the first repeat of the record is checked.

    Attributes
    ----------
    verdict
        The verdict on the record; None if there is none.
    model
        The study's model with the damping and the restoring law of the answer; without an answer, the study's most
        probable model. None if the study has no such model.
    coefficient_names
        Names of the damping coefficients of `model`; [] without a model.
    answer_coefficients
        The coefficients in the answer, by name; {} without an answer.
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
        self.answer_coefficients = {c.name: c for c in v.coefficients} if v else {}
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
        checks = [
            *self._convergence(),
            *self._maxima(),
            *self._ratios(),
            *self._coefficients(),
            *self._evidence(evidence),
        ]
        checks += self._residuals()
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

    def _convergence(self) -> Iterator[Check]:
        """Yield a check of each sampler of `model`.

        It is a failed one with the sampler's outcome if this is neither `ok` nor among `UNLISTED_OUTCOMES`; else it
        gives the largest R̂ and the smallest effective sample size.
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

    def _maxima(self) -> Iterator[Check]:
        """Yield a failed check if the posterior of `model` has another maximum with more than `LARGEST_OTHER`."""
        mode = mode_of(self.run, self.signal, self.repeat, self.model) if self.model else None
        share = max(mode.shares[1:], default=0.0) if mode else 0.0
        if share > LARGEST_OTHER:
            yield Check(
                f"Another maximum of {words.model(self.model or '')} has {fmt.percentage(share)} % of the posterior "
                "probability; chains and evidence may not include it.",
                fails=True,
            )

    def _ratios(self) -> Iterator[Check]:
        """Yield a check that compares the damping ratios from the chains with the answer's; none without both.

        It fails if, at the amplitude with the worst agreement, the ratio differs by at least `AGREEMENT_SDS` standard
        deviations of the answer, or its interval is at least `WIDTHS_AGREE` times as wide. It never fails if
        `exact_only`, or if the chains have only the answer's damping and another one is more probable.
        """
        v = self.verdict
        drawn = self._drawn_ratios(v) if v is not None else None
        if v is None or drawn is None:
            return
        sampler, ratios, averaged = drawn
        name = f"{_name(sampler)}, averaged over the damping models," if averaged else _name(sampler)
        likelier = [r for r in v.rivals if r.probability > v.probability]
        if not averaged and v.probability < 0.5 and likelier:
            yield Check(
                f"{name} sampled {words.model(v.damping)} damping alone, which has probability "
                f"{fmt.probability(v.probability)} in the answer; {words.model(likelier[0].damping)} has "
                f"{fmt.probability(likelier[0].probability)}."
            )
            return

        def ratio_at(i: int) -> str:
            """Return the damping ratio from the chains at the i-th amplitude, as text."""
            place = v.damping_ratio[i]
            size = fmt.with_interval(*ratios[i], " %", 100)
            return f"{size} at {fmt.compact(place.amplitude, 2)} {place.unit}"

        worst, middle = worst_agreement(v, ratios), ratio_at(len(ratios) // 2)
        if self.exact_only:
            yield Check(
                f"{name} assumes that laws hold exactly and gives a damping ratio of {middle}; the answer allows "
                "deviations."
            )
        elif worst.confirms:
            yield Check(f"{name} confirms the damping ratio: {middle}.")
        else:
            largest = ratio_at(
                next(i for i, r in enumerate(v.damping_ratio) if r.amplitude == worst.amplitude)
            )
            width = f"an interval {worst.wider:.1f} times as wide"
            text = f"{name} agrees with the damping ratio but gives {width}: {largest}."
            if worst.moved >= AGREEMENT_SDS:
                text = (
                    f"{name} contradicts the damping ratio: it gives {largest}, which differs by {worst.moved:.1f} of "
                    f"the answer's standard deviations, with {width}."
                )
            yield Check(text, fails=worst.moved >= AGREEMENT_SDS or worst.wider > 1)

    def _drawn_ratios(self, v: Verdict) -> tuple[str, list[tuple[float, float, float]], bool] | None:
        """Return the damping ratios from the chains at the answer's amplitudes; None if there are none.

        Returns
        -------
        tuple
            The sampler; median and ends of the 95 % interval (value, low, high) of the ratio at each amplitude; whether
            the ratios are averaged over the damping models by their evidence. Otherwise they are those of the answer's
            damping.
        """
        if not v.damping_ratio:
            return None
        run, signal, repeat = self.run, self.signal, self.repeat
        at = np.log([r.amplitude / run.unit(signal).displacement.scale for r in v.damping_ratio])

        def of_curve(arrays: Mapping[str, np.ndarray]) -> list[tuple[float, float, float]]:
            grid = np.log(arrays["amplitudes"])
            low, middle, high = (np.interp(at, grid, row) for row in arrays["curve/equivalent_ratio"])
            return [(float(m), float(a), float(b)) for a, m, b in zip(low, middle, high, strict=True)]

        averaged = run.task_result("averaged", signal, repeat)
        if averaged is not None and averaged.outcome == OK and averaged.arrays["amplitudes"].size > 1:
            return "nuts", of_curve(averaged.arrays), True
        rows = rows_of(run.posteriors, signal=signal, restoring=v.restoring, outcome=OK)
        rows = [r for r in rows if _same_sum([damping_of(r)], v.damping) and r["sampler"] != ANSWER_SAMPLER]
        for model, sampler in dict.fromkeys((r["model"], r["sampler"]) for r in rows):
            task_result = run.task_result("posterior", signal, repeat, model, sampler)
            content = PosteriorContent.maybe(task_result)
            if task_result is None or content is None:
                continue
            if len(content.ratios) == len(v.damping_ratio):
                return sampler, [(r.value, r.low, r.high) for r in content.ratios], False
            if task_result.arrays.get("amplitudes", np.empty(0)).size > 1:
                return sampler, of_curve(task_result.arrays), False
        return None

    def _coefficients(self) -> Iterator[Check]:
        """Yield a failed check for each contradiction to a coefficient of the answer.

        A chain contradicts the answer if its median differs from the answer's value by at least `AGREEMENT_SDS` of the
        answer's standard deviations. A trajectory fit or the true value contradicts it outside the answer's 95 %
        interval; all such fits are counted in one check. Chains and fits are not compared if `exact_only`. Without an
        answer, only the true value is compared, with the first chain's interval.
        """
        chains = self._samplers()
        limits = {name: (c.low, c.high) for name, c in self.answer_coefficients.items()}
        if self.verdict is None:
            rows = next(iter(chains.values()), [])
            limits = {r["parameter"]: (r["q2.5"], r["q97.5"]) for r in rows}
        for name in filter(limits.__contains__, self.coefficient_names):
            symbol, (low, high) = words.symbol(name).text, limits[name]
            comparable = name in self.answer_coefficients and not self.exact_only
            for sampler, rows in chains.items() if comparable else ():
                for r in rows_of(rows, parameter=name, outcome=OK):
                    moved = (
                        abs(r["median"] - self.answer_coefficients[name].value)
                        * 2
                        * NORMAL_95
                        / max(high - low, 1e-300)
                    )
                    if moved >= AGREEMENT_SDS:
                        text = (
                            f"{_name(sampler)} contradicts the answer: its {symbol} differs by {moved:.1f} of the "
                            "answer's standard deviations."
                        )
                        yield Check(text, fails=True)
            rows = (
                self._rows(self.run.estimates, stage="refined", parameter=name, outcome=OK)
                if comparable
                else []
            )
            fits = [r["value"] for r in rows if math.isfinite(r["value"])]
            outside = [value for value in fits if not low <= value <= high]
            if outside:
                text = (
                    f"{len(outside)} of {len(fits)} trajectory fits give {symbol} = {fmt.spread(outside)}, outside the "
                    "answer's 95 % interval."
                )
                yield Check(text, fails=True)
            true = truth(self.run, self.signal, name)
            if math.isfinite(true) and not low <= true <= high:
                yield Check(
                    f"Truth: {symbol} = {fmt.as_entered(true)}, which is outside the 95 % interval.",
                    fails=True,
                )

    def _evidence(self, ranked: EvidenceRanking | None) -> Iterator[Check]:
        """Yield checks that compare the probabilities from the study's evidence with those of the answer.

        They report evidence that failed or is unreliable; each method's probability of the answer's damping (a failed
        check if its log odds differ from the answer's by more than `CLEAR_NATS`); methods that rank another damping
        first; and how the result depends on the width of the priors and on the repeat.
        `ranked` is the result of `rank_models`. There are none if the study has no evidence besides that of the answer.
        """
        if ranked is None or ranked.method == ANSWER_SAMPLER:
            return
        run, signal, repeat, v = self.run, self.signal, self.repeat, self.verdict
        # Evidence values that failed or are unreliable.
        for row in rows_of(run.evidence, signal=signal, repeat=repeat):
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
        leading = next(iter(ranked.dampings))
        named = _same_sum(ranked.dampings, v.damping) if v else leading
        if named is not None:
            by = fmt.listing(f"{fmt.probability(p[named])} by {words.method(m)}" for m, p in shares.items())
            answer, apart = "", 0.0
            if v is not None:
                each = [(v.damping, v.probability), *((r.damping, r.probability) for r in v.rivals)]
                total = sum(p for damping, p in each if _same_sum(ranked.dampings, damping) is not None)
                if total > 0:
                    own = v.probability / total
                    answer = f"; the answer gives {fmt.probability(own)}"
                    # If the evidence ranks another damping first, this has a check of its own below.
                    p = shares.get(ranked.method, {})
                    if p and p[named] == max(p.values()):
                        apart = abs(_log_odds(p[named]) - _log_odds(own))
            contradicts = apart > CLEAR_NATS and not self.exact_only
            if contradicts:
                answer = f"{answer}, and the log odds differ by {apart:.1f} nats"
            yield Check(
                f"Probability of {words.model(named)} damping among the damping models of the study: "
                f"{by}{answer}.",
                fails=contradicts,
            )
        # Methods that rank another damping first.
        for method, p in shares.items():
            first = max(p, key=lambda damping: p[damping])
            if first == named:
                continue
            text = (
                f"{_name(method)} ranks {words.model(first)} damping first, with probability "
                f"{fmt.probability(p[first])}"
            )
            if self.exact_only:
                text = f"If the laws held exactly: {text}. The ranking depends on how closely the laws hold."
            else:
                text = f"{text}, which contradicts {'the answer' if v else words.method(ranked.method)}."
            yield Check(text, fails=not self.exact_only)
        # The dependence on the width of the priors, and on the repeat of the record.
        widths = probability_by_width(run, signal, repeat, ranked)
        factor = min(widths, key=lambda f: widths[f], default=1.0)
        if widths and widths[factor] < min(WIDTH_HOLDS, ranked.dampings[leading]):
            text = (
                f"The result depends on the width of the priors: with priors {fmt.number(factor, 2)} times as wide, "
                f"the probability of {words.model(leading)} is {fmt.probability(widths[factor])}."
            )
            yield Check(text, fails=True)
        rankings = [r for r in (rank_models(run, signal, each) for each in run.repeats(signal)) if r]
        if len(rankings) > 1:
            firsts = [next(iter(r.dampings.items())) for r in rankings]
            wins = Counter(damping for damping, _ in firsts)
            counted = fmt.listing(f"{words.model(d)} in {n}" for d, n in wins.most_common())
            yield Check(
                f"Most probable damping by evidence in {len(rankings)} repeats of this record: {counted} (probability "
                f"at least {fmt.probability(min(p for _, p in firsts))})."
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
