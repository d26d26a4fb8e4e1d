"""The first sentence: a misfit is said before any probability."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from bayesdamp.report.verdict import verdict

FITS, LEFT = "fits", "does not fit: structure is left in the residuals"


def run(
    probabilities: dict[str, float], checks: dict[str, str], odd: tuple[str, ...] = ()
) -> SimpleNamespace:
    common = {"signal": "a", "repeat": 0, "restoring": "linear", "method": "importance", "outcome": "ok"}
    evidence = [
        {**common, "model": m, "probability": p, "log_evidence": 10 * p} for m, p in probabilities.items()
    ]
    return SimpleNamespace(
        evidence=evidence,
        fits=[{**common, "model": m, "verdict": v} for m, v in checks.items()],
        cell=lambda *_: SimpleNamespace(meta={"anomalies": odd}),
    )


@pytest.mark.parametrize(
    ("probabilities", "checks", "misfit", "first"),
    [
        ({"viscous": 0.99, "coulomb": 0.01}, {"viscous": FITS, "coulomb": LEFT}, False, "damping is viscous,"),
        ({"viscous": 0.7, "coulomb": 0.3}, {"viscous": FITS, "coulomb": FITS}, False, "damping is most likely viscous"),
        ({"viscous": 0.99, "coulomb": 0.01}, {"viscous": LEFT, "coulomb": LEFT}, True, "no candidate fits"),
        ({"viscous": 0.99, "coulomb": 0.01}, {"viscous": LEFT, "coulomb": FITS}, True, "the most probable"),
    ],
)  # fmt: skip
def test_the_first_sentence(probabilities, checks, misfit: bool, first: str) -> None:
    found = verdict(run(probabilities, checks), "a", 0)  # type: ignore[arg-type]
    assert found.misfit == misfit
    assert found.sentence.startswith(first)
    if misfit:
        assert found.sentence.index("fit") < found.sentence.index("0.990")


def test_what_the_record_shows_by_itself_comes_before_a_fit() -> None:
    fits = {"viscous": FITS, "coulomb": FITS}
    found = verdict(run({"viscous": 0.99, "coulomb": 0.01}, fits, ("its peaks are cut off",)), "a", 0)  # type: ignore[arg-type]
    assert found.misfit
    assert found.sentence.index("its peaks are cut off") < found.sentence.index("0.990")
