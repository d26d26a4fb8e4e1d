"""What tables say of a task reads back as what it was."""

from __future__ import annotations

import pytest

from bayesdamp.outcomes import Fitting, Status, fitting_of, following, reason_of, status_of


@pytest.mark.parametrize("status", [s for s in Status if s not in (Status.OK, Status.REFUSED)])
def test_an_outcome_reads_back(status: Status) -> None:
    said = status.because("ValueError: no such thing")
    assert status_of(said) is status
    assert reason_of(said) == "ValueError: no such thing"


@pytest.mark.parametrize(
    "said", ["", "okay", "no oscillation", "failedly: it did", "the search failed: it ended", "pruneds"]
)
def test_a_sentence_that_names_no_status_is_a_refusal(said: str) -> None:
    assert status_of(said) is Status.REFUSED
    assert reason_of(said) == said


def test_ok() -> None:
    assert status_of("ok") is Status.OK


def test_what_depends_on_a_failure_says_which() -> None:
    failed = Status.FAILED.because("ValueError: x")
    assert following("mode/a/0/viscous", failed) == "not computed: mode/a/0/viscous failed: ValueError: x"
    assert status_of(following("mode/a/0/viscous", failed)) is Status.NOT_COMPUTED
    assert following("mode/a/0/viscous", "no oscillation") == "no oscillation"


@pytest.mark.parametrize(
    ("said", "fitting"),
    [
        ("fits", Fitting.FITS),
        ("fits, with correlated noise", Fitting.FITS),
        (Fitting.DOES_NOT_FIT.because("outliers"), Fitting.DOES_NOT_FIT),
        ("", None),
    ],
)
def test_whether_a_model_fits(said: str, fitting: Fitting | None) -> None:
    assert fitting_of(said) is fitting
