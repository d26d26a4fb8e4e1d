"""The checks below an answer: what confirms it, what contradicts it, and what cannot be trusted."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from bayesdamp.priors import FURTHER_TERM
from bayesdamp.report.results.checks import RecordChecks
from bayesdamp.report.results.run import RunFolder, probabilities_by_odds, rank_models
from bayesdamp.store.results import AnswerContent, ModeContent, TaskResult
from bayesdamp.types import UNITS
from bayesdamp.verdict.parts import Coefficient, DampingRatio, Grade, Interval, Rival
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import sentence

NO_CURVATURE = "the posterior's information matrix is not positive definite at its mode."
MISFIT = {"verdict": "does not fit: why", "window_spread": 1.0, "predictive_p": 0.5, "model": "viscous"}
ROW = {"signal": "a", "repeat": 0, "restoring": "linear", "outcome": "ok"}


def verdict(damping: str = "viscous", probability: float = 0.98, **changes: Any) -> Verdict:
    """Return a verdict with a damping ratio of 1 % at 0.2 rad and ζ = 0.05 ± 0.002."""
    ratio = DampingRatio(0.2, "rad", 0.01, 0.0002, 0.0004, 0.009, 0.011)
    zeta = Coefficient("zeta", 0.05, 0.001, 0.0, 0.048, 0.052, "1/s")
    result = Verdict("a", Grade.EXACT, probability > 0.95, damping, probability, restoring="linear")
    return replace(result, **{"damping_ratio": (ratio,), "coefficients": (zeta,), **changes})


def cell(kind: str, v: Verdict) -> TaskResult:
    v = replace(v, sentence=sentence(v))
    return TaskResult(f"{kind}/a/0", "key", AnswerContent(v.to_dict()).meta())


def evidence(method: str = "importance", **probabilities: float) -> list[dict]:
    row = {**ROW, "method": method}
    return [{**row, "model": m, "probability": p, "log_evidence": 10 * p} for m, p in probabilities.items()]


def chain(sampler: str = "nuts", at: float = 0.05, outcome: str = "ok") -> list[dict]:
    quantiles = {"mean": at, "median": at, "q2.5": at - 0.002, "q97.5": at + 0.002}
    sizes = {"rhat": 1.002, "ess_bulk": 3000.0, "ess_tail": 2500.0}
    common = {**ROW, "model": "viscous", "sampler": sampler, "parameter": "zeta", "unit": "1/s"}
    row = {**common, **quantiles, **sizes, "outcome": outcome}
    return [row, {**row, "parameter": "stiffness", "rhat": 1.0, "ess_tail": 2600.0}]


ESTIMATE = {**ROW, "model": "viscous", "stage": "refined", "parameter": "zeta", "truth": 0.05}


class Parts(SimpleNamespace):
    """An object with the given attributes; like a `RunFolder`, it can be a key of a cache."""

    __hash__ = object.__hash__  # type: ignore[assignment]


def run_of(answer: Verdict | None = None, truth: str = "", **given: Any) -> RunFolder:
    """Return an object with the parts of a run that checks read; `results`: functions of the parts of a task's name."""
    results = {"answer": lambda *_: cell("answer", answer) if answer else None, **given.pop("results", {})}
    parts = {
        **{key: [] for key in ("models", "estimates", "posteriors", "evidence", "fits")},
        **{"signals": ["a"], "info": {}, "answered": {}, "under_law": False},
        "repeats": lambda _: [0],
        "task_result": lambda kind, *name: results[kind](*name) if kind in results else None,
        "task_results": lambda *_: [],
        "unit": lambda _: UNITS["rad"],
        "is_simulated": lambda _: bool(truth),
        "simulation": lambda _: {"damping": truth.split("+")} if truth else {},
        "provenance": lambda _: SimpleNamespace(warnings=()),
    }
    return cast(RunFolder, Parts(**{**parts, **given}))


def checked(run: RunFolder) -> tuple[list[str], list[str]]:
    """Return the sentences of the checks that pass, and of those that fail."""
    result = RecordChecks(run, "a").all()
    return [c.text for c in result if not c.fails], [c.text for c in result if c.fails]


def test_a_record_on_which_everything_agrees_has_no_failure() -> None:
    tables = {
        "posteriors": chain() + chain("emcee"),
        "evidence": evidence(viscous=0.99, coulomb=0.01),
        "fits": [{**ROW, "model": "viscous", "verdict": "fits", "window_spread": 0.7, "predictive_p": 0.995}],
    }
    passed, failed = checked(run_of(verdict(), truth="viscous", **tables))
    assert failed == []
    assert passed == [
        "NUTS converged: R̂ at most 1.002, effective sample size at least 2,500.",
        "emcee converged: R̂ at most 1.002, effective sample size at least 2,500.",
        "Probability of viscous damping among the damping models of the study: 0.99 by importance sampling; the "
        "answer gives > 0.999.",
        "Residuals: viscous damping fits.",
        "Truth: the record was simulated with viscous damping, as the answer says.",
    ]


CONTRADICTIONS: dict[str, dict[str, Any]] = {
    "NUTS: not converged: R̂ of ζ": {"posteriors": chain(outcome="not converged: R̂ of ζ is 1.03.")},
    "0.30 by importance sampling; the answer gives 0.98, and the log odds differ by 4.7 nats.": {
        "evidence": evidence(coulomb=0.7, viscous=0.3)
    },
    "0.65 by importance sampling; the answer gives 0.98, and the log odds differ by 3.3 nats.": {
        "evidence": evidence(viscous=0.65, coulomb=0.35)
    },
    "Residuals: viscous damping does not fit: why.": {"fits": [{**ROW, **MISFIT}], "posteriors": chain()},
    "look different from this one (predictive p 0.0050).": {
        "fits": [{**ROW, **MISFIT, "predictive_p": 0.005}],
        "posteriors": chain(),
    },
    "with Coulomb damping, to which the answer gives the probability 0.02.": {
        "truth": "coulomb",
        "posteriors": chain(),
    },
    "Truth: ζ = 0.06, which is outside": {"truth": "viscous", "estimates": [{**ESTIMATE, "truth": 0.06}]},
    "The evidence of Coulomb (importance sampling) is missing or unreliable: the posterior": {
        "evidence": [*evidence(viscous=0.99), {**evidence(coulomb=math.nan)[0], "outcome": NO_CURVATURE}]
    },
}


def test_what_contradicts_the_answer_is_a_failed_check() -> None:
    answer = verdict(rivals=(Rival("coulomb", 0.02),))
    failed = {text: checked(run_of(answer, **changes))[1] for text, changes in CONTRADICTIONS.items()}
    assert [text for text, sentences in failed.items() if not any(text in s for s in sentences)] == []


def test_a_check_that_assumes_exact_laws_does_not_contradict_an_answer_with_deviations() -> None:
    """Control: with the same assumptions the same tables contradict it."""
    tables = {"evidence": evidence(coulomb=0.7, viscous=0.3), "fits": [{**ROW, **MISFIT}]}
    about = verdict(deviation=Interval(0.02, 0.0, 0.04))
    passed, failed = checked(run_of(about, **tables))
    assert failed == []
    assert "0.30 by importance sampling; the answer gives" in " ".join(passed)
    assert "assume that the laws hold exactly" in passed[-1]
    assert len(checked(run_of(verdict(), **tables))[1]) == 2
    assert len(checked(run_of(about, under_law=True, **tables))[1]) == 1  # exact fits are not compared there


def test_a_second_maximum_is_a_failed_check() -> None:
    def failed(share: float) -> list[str]:
        mode = TaskResult("mode/a/0/viscous", "key", ModeContent(shares=(1 - share, share)).meta())
        return checked(run_of(verdict(), posteriors=chain(), results={"mode": lambda *_: mode}))[1]

    (text,) = failed(0.2)
    assert text.startswith("Another maximum of viscous has 20 % of the posterior probability;")
    assert failed(0.02) == []


def test_the_damping_ratio_of_chains_confirms_or_contradicts() -> None:
    """Each sampler has a check. Control: chains of a model that is not nearly certain contradict nothing."""

    def ratios(value: float, half: float, probability: float = 0.98) -> tuple[str, str]:
        row = {"amplitude": 0.2, "value": value, "low": value - half, "high": value + half}
        chains = SimpleNamespace(meta={"ratios": [{**row, "sd_noise": 0.0, "sd_law": 0.0}]}, arrays={})
        tables = {"posteriors": chain() + chain("emcee"), "results": {"posterior": lambda *_: chains}}
        passed, failed = checked(run_of(verdict(probability=probability), **tables))
        return " ".join(passed), " ".join(failed)

    passed, failed = ratios(0.01, 0.001)
    for name in ("NUTS", "emcee"):
        assert f"{name} confirms the damping ratio: 1.000 % (0.900 to 1.100) at 0.2 rad." in passed
    assert not failed
    assert "contradicts the damping ratio: it gives 1.10 % (1.00 to 1.20) at 0.2" in ratios(0.011, 0.001)[1]
    passed, failed = ratios(0.01, 0.0005)
    assert "gives an interval 0.5 times as wide: 1.000 % (0.950 to 1.050) at 0.2 rad" in passed
    assert not failed
    passed, failed = ratios(0.011, 0.001, 0.7)
    assert "emcee sampled viscous damping alone, which has probability 0.70 in the answer, and" in passed
    assert not failed


def test_probabilities_under_other_prior_odds_of_a_further_term() -> None:
    """With the factor halved, 0.6 to 0.4 for the sum becomes 0.3 to 0.4; sums over two laws are moved together."""
    probabilities = {"viscous+coulomb": 0.6, "viscous@linear": 0.3, "viscous@pendulum": 0.1}
    shares = probabilities_by_odds(rank_models(run_of(evidence=evidence(**probabilities)), "a", 0))
    assert list(shares) == [0.5 * FURTHER_TERM, FURTHER_TERM, 2 * FURTHER_TERM]
    lower, own, higher = shares.values()
    assert own == pytest.approx({"viscous+coulomb": 0.6, "viscous": 0.4})
    assert lower == pytest.approx({"viscous": 0.4 / 0.7, "viscous+coulomb": 0.3 / 0.7})
    assert higher["viscous+coulomb"] == pytest.approx(1.2 / 1.6)
    single = rank_models(run_of(evidence=evidence(viscous=0.6, coulomb=0.4)), "a", 0)
    assert probabilities_by_odds(single) == {}  # all have as many terms
