"""The first sentence: a misfit is said before any probability."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from bayesdamp.odds import FURTHER_TERM
from bayesdamp.report.results.reading import over_odds, ranking
from bayesdamp.report.results.verdict import verdict
from bayesdamp.report.sections.study import summary

FITS, LEFT = "fits", "does not fit: structure is left in the residuals"


def run(
    probabilities: dict[str, float],
    checks: dict[str, str],
    odd: tuple[str, ...] = (),
    widths: dict[str, list[float]] | None = None,
    rivals: tuple[tuple[str, float], ...] = (),
    under_law: bool = False,
) -> SimpleNamespace:
    common = {"signal": "a", "repeat": 0, "restoring": "linear", "method": "importance", "outcome": "ok"}
    evidence = [
        {**common, "model": m, "probability": p, "log_evidence": 10 * p} for m, p in probabilities.items()
    ]
    return SimpleNamespace(
        under_law=under_law,
        evidence=evidence,
        fits=[{**common, "model": m, "verdict": v} for m, v in checks.items()],
        cell=lambda *parts: (
            width(parts[3], widths or {})
            if parts[0] == "sensitivity"
            else SimpleNamespace(
                meta={"anomalies": odd, "rivals": [{"words": w, "log_bayes": b} for w, b in rivals]},
                outcome="ok",
            )
        ),
    )


def width(model: object, log_evidence: dict[str, list[float]]) -> SimpleNamespace | None:
    """The cell of a candidate's evidence under priors a tenth as wide, as they are, and ten times as wide."""
    if model not in log_evidence:
        return None
    arrays = {"factors": np.array([0.1, 1.0, 10.0]), "log_evidence": np.array(log_evidence[str(model)])}
    return SimpleNamespace(outcome="ok", arrays={**arrays, "trusted": np.ones(3, bool)})


@pytest.mark.parametrize(
    ("probabilities", "checks", "misfit", "first"),
    [
        ({"viscous": 0.99, "coulomb": 0.01}, {"viscous": FITS, "coulomb": LEFT}, False, "damping is viscous,"),
        ({"viscous": 0.7, "coulomb": 0.3}, {"viscous": FITS, "coulomb": FITS}, False, "the record does not decide"),
        ({"viscous": 0.99, "coulomb": 0.01}, {"viscous": LEFT, "coulomb": LEFT}, True, "no model fits"),
        ({"viscous": 0.99, "coulomb": 0.01}, {"viscous": LEFT, "coulomb": FITS}, True, "the most probable"),
    ],
)  # fmt: skip
def test_the_first_sentence(probabilities, checks, misfit: bool, first: str) -> None:
    found = verdict(run(probabilities, checks), "a", 0)  # type: ignore[arg-type]
    assert found.misfit == misfit
    assert found.sentence.startswith(first)
    assert found.open == first.startswith("the record does not decide")
    if misfit:
        assert found.sentence.index("fit") < found.sentence.index("0.990")


def test_where_laws_need_not_hold_exactly_what_exact_fits_leave_is_no_misfit() -> None:
    """Control: under exact laws it is."""
    left, told = {"viscous": LEFT, "coulomb": LEFT}, {"viscous": 0.99, "coulomb": 0.01}
    forms = (("damping changes with time", 30.0),)
    found = verdict(run(told, left, rivals=forms, under_law=True), "a", 0)  # type: ignore[arg-type]
    assert not found.misfit
    assert not found.rivals
    assert found.sentence.startswith("damping is viscous,")
    assert verdict(run(told, left, rivals=forms), "a", 0).misfit  # type: ignore[arg-type]


def test_what_the_record_shows_by_itself_comes_before_a_fit() -> None:
    fits = {"viscous": FITS, "coulomb": FITS}
    found = verdict(run({"viscous": 0.99, "coulomb": 0.01}, fits, ("its peaks are cut off",)), "a", 0)  # type: ignore[arg-type]
    assert found.misfit
    assert found.sentence.index("its peaks are cut off") < found.sentence.index("0.990")


def test_an_answer_that_rests_on_the_priors_width_says_so_before_any_probability() -> None:
    """Odds of 99 that a prior a tenth as wide turns into 99 / 20 are no answer of the record's; 99 / 2 are one."""
    fits, told = {"viscous": FITS, "coulomb": FITS}, {"viscous": 0.99, "coulomb": 0.01}
    resting = {"viscous": [-5.0, -5.0, -5.0], "coulomb": [-9.6 + np.log(40.0), -9.6, -11.9]}
    found = verdict(run(told, fits, widths=resting), "a", 0)  # type: ignore[arg-type]
    assert found.open
    assert not found.misfit
    assert found.sentence.startswith("how wide the priors are decides between viscous and Coulomb")
    assert "0.712 under priors 0.10 times as wide" in found.sentence  # 0.99 / (0.99 + 0.01 * 40)
    firm = {"viscous": [-5.0, -5.0, -5.0], "coulomb": [-9.6 + np.log(2.0), -9.6, -11.9]}
    held = verdict(run(told, fits, widths=firm), "a", 0)  # type: ignore[arg-type]
    assert held.sentence.startswith("damping is viscous,")
    assert not held.open


def test_where_nothing_was_weighed_the_first_reason_is_given() -> None:
    cells = {
        "noise": None,
        "viscous": SimpleNamespace(outcome="ok"),
        "coulomb": SimpleNamespace(outcome="it escapes."),
    }
    empty = SimpleNamespace(
        evidence=[],
        fits=[],
        info={"models": ["viscous", "coulomb"]},
        cell=lambda kind, *parts: cells[parts[-1] if kind == "mode" else kind],
    )
    found = verdict(empty, "a", 0)  # type: ignore[arg-type]
    assert found.sentence == "nothing was weighed, so no damping can be named: it escapes."
    assert found.open
    del cells["coulomb"]
    empty.info = {"models": ["viscous"]}
    assert verdict(empty, "a", 0).sentence.endswith("can be named.")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("shares", "said", "opened"),
    [
        (
            {"viscous@pendulum": 0.52, "viscous@linear": 0.46, "coulomb@linear": 0.02},
            "damping is viscous, with probability 0.980 among 3 models; the restoring law is left open: "
            "pendulum (0.520) or linear (0.460).",
            False,
        ),
        (
            {"viscous@pendulum": 0.96, "viscous@linear": 0.02, "coulomb@linear": 0.02},
            "damping is viscous (pendulum), with probability 0.960 among 3 models.",
            False,
        ),
        (
            {"coulomb@pendulum": 0.40, "viscous@pendulum": 0.35, "viscous@linear": 0.25},
            "the record does not decide between viscous and Coulomb: damping is most likely viscous, with "
            "probability 0.600.",
            True,
        ),
    ],
)  # fmt: skip
def test_a_law_that_is_left_open_leaves_no_damping_open(
    shares: dict[str, float], said: str, opened: bool
) -> None:
    """The question is which damping: probabilities are summed over the restoring laws, as odds of laws that a small
    amplitude cannot tell apart say nothing of it."""
    found = verdict(run(shares, dict.fromkeys(shares, FITS)), "a", 0)  # type: ignore[arg-type]
    assert found.sentence == said
    assert found.open == opened


def test_the_priors_width_is_judged_over_all_laws() -> None:
    """A law that takes over from another at another width leaves its damping where it was."""
    told = {"viscous@pendulum": 0.6, "viscous@linear": 0.39, "coulomb@linear": 0.01}
    fine = dict.fromkeys(told, FITS)
    swapped = {
        m: [-5.0 + np.log(told[m]) + s * np.log(20.0), -5.0 + np.log(told[m]), -5.0 + np.log(told[m])]
        for m, s in zip(told, (0, 1, 0))
    }
    assert not verdict(run(told, fine, widths=swapped), "a", 0).open  # type: ignore[arg-type]
    risen = {**swapped, "coulomb@linear": [-5.0 + np.log(0.01) + np.log(2000.0), -5.0 + np.log(0.01), -20.0]}
    assert verdict(run(told, fine, widths=risen), "a", 0).open  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("rivals", "first"),
    [
        ((), "damping is viscous, with"),
        ((("a", -1.5), ("b", -5.0)), "damping is viscous, with"),
        ((("a", -1.3),), "the record leaves open whether a (0.214); without that, damping is viscous,"),
        ((("b", -1.5), ("a", 0.0)), "the record leaves open whether a (0.500); without that, damping is viscous, with"),
        ((("b", 0.0), ("a", 1.0)), "the record leaves open whether a or b (the first: 0.731); without these, damping"),
        (
            (("a", 0.3), ("b", 0.2), ("c", 0.1), ("d", 0.0)),
            "the record leaves open most other forms of damping (that a: 0.574); without these, damping is viscous",
        ),
    ],
)  # fmt: skip
def test_what_the_record_leaves_open_is_said_first(rivals: tuple[tuple[str, float], ...], first: str) -> None:
    """A form beside the candidate that leaves it less than 0.8: odds above a quarter, a log Bayes factor of -1.386."""
    shares, fine = {"viscous": 0.99, "coulomb": 0.01}, {"viscous": FITS, "coulomb": LEFT}
    found = verdict(run(shares, fine, rivals=rivals), "a", 0)  # type: ignore[arg-type]
    assert found.sentence.startswith(first)
    possible = [name for name, b in sorted(rivals, key=lambda one: -one[1]) if b > -np.log(4)]
    assert [name for name, _ in found.rivals] == possible
    assert found.open == bool(possible)
    assert not found.misfit
    left = verdict(run({"viscous": 0.6, "coulomb": 0.4}, fine, rivals=rivals), "a", 0)  # type: ignore[arg-type]
    assert left.sentence.startswith("the record does not decide")


def test_a_candidate_that_could_not_be_weighed_is_said_before_any_probability() -> None:
    shares = {"viscous": 0.99, "quadratic": 0.01, "coulomb": math.nan}
    made = run(shares, {"viscous": FITS, "quadratic": FITS})
    made.evidence[2]["outcome"] = "the posterior has no curvature at its mode."
    found = verdict(made, "a", 0)  # type: ignore[arg-type]
    assert found.sentence == (
        "Coulomb could not be weighed (the posterior has no curvature at its mode); of the others, damping is viscous, "
        "with probability 0.990 among 2 models."
    )


@pytest.mark.parametrize(("share", "opened"), [(0.01, True), (1e-4, False)])
def test_an_evidence_that_is_not_to_be_trusted_decides_nothing_if_it_matters(
    share: float, opened: bool
) -> None:
    made = run({"viscous": 1 - share, "coulomb": share}, {"viscous": FITS, "coulomb": FITS})
    made.evidence[1]["outcome"] = "not to be trusted: Pareto shape of the weights is 0.75, above 0.7"
    found = verdict(made, "a", 0)  # type: ignore[arg-type]
    assert found.open == opened
    assert found.sentence.startswith(
        "the evidence of Coulomb is not settled" if opened else "damping is viscous"
    )
    # Nor does it matter of a candidate that has next to no rival.
    made.evidence[0]["outcome"], made.evidence[1]["outcome"] = made.evidence[1]["outcome"], "ok"
    assert verdict(made, "a", 0).open == opened  # type: ignore[arg-type]
    made.evidence[0]["outcome"], made.evidence[1]["outcome"] = "ok", made.evidence[0]["outcome"]
    # A rough method that covers as many models does not step in for it.
    rough = [{**row, "method": "laplace", "outcome": "ok", "probability": 0.5} for row in made.evidence]
    made.evidence = [*made.evidence, *rough]
    assert verdict(made, "a", 0).sentence == found.sentence  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("lead", "sd", "own", "told"),
    [
        (2.0, 0.0004, "mu_c", True),
        (2.0, 0.002, "mu_c", False),  # within the interval
        (4.0, 0.0004, "mu_c", False),  # the other does not suit the record
        (2.0, 0.0004, "zeta", False),  # a candidate without friction
    ],
)
def test_an_interval_that_another_epsilon_moves_is_told_of(monkeypatch, lead, sd, own, told) -> None:
    def tried(log_evidence: float, value: float) -> dict[str, object]:
        found = {"mu_c": [value, 0.001], "zeta": [value, 0.001]}
        return {"share": 0.02, "epsilon": 0.1, "log_evidence": log_evidence, "coefficients": found}

    meta = {"friction": ["mu_c"], "epsilons": [tried(-lead, 0.0807), tried(0.0, 0.0799)]}
    meta |= {"chosen": "gaussian", "damping": ["coulomb"], "restoring": "linear", "fits": {}, "weighed": []}
    run = SimpleNamespace(cell=lambda *_: SimpleNamespace(meta=meta, outcome="ok"))
    rows = [{"parameter": own, "sd": sd, "unit": "rad/s2"}]
    monkeypatch.setattr(summary, "summary_rows", lambda *_: ("nuts", rows))
    monkeypatch.setattr(summary, "coefficients", lambda *_: [own])
    doubt: list[str] = []
    summary._friction(run, "s", 0, "m", doubt)  # type: ignore[arg-type]
    assert bool(doubt) == told
    if told:
        assert "μc by 0.00080 rad/s²" in doubt[0]


def test_probabilities_under_other_prior_odds_of_a_further_term() -> None:
    """With the factor halved, 0.6 to 0.4 for the sum becomes 0.3 to 0.4; sums over two laws are moved together."""
    told = {"viscous+coulomb": 0.6, "viscous@linear": 0.3, "viscous@pendulum": 0.1}
    found = ranking(run(told, {}), "a", 0)  # type: ignore[arg-type]
    assert found is not None
    lower, own, higher = over_odds(found)
    assert [lower.factor, own.factor, higher.factor] == [0.5 * FURTHER_TERM, FURTHER_TERM, 2 * FURTHER_TERM]
    assert own.dampings == pytest.approx({"viscous+coulomb": 0.6, "viscous": 0.4})
    assert lower.dampings == pytest.approx({"viscous": 0.4 / 0.7, "viscous+coulomb": 0.3 / 0.7})
    assert next(iter(lower.dampings)) == "viscous"
    assert higher.dampings["viscous+coulomb"] == pytest.approx(1.2 / 1.6)
    single = ranking(run({"viscous": 0.6, "coulomb": 0.4}, {}), "a", 0)  # type: ignore[arg-type]
    assert single is not None
    assert over_odds(single) == []  # all have as many terms
