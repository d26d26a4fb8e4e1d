"""What tables say of a task reads back as what it was."""

from __future__ import annotations

from bayesdamp.outcomes import Fitting, Status, fitting_of, following, reason_of, status_of


def test_an_outcome_reads_back() -> None:
    for status in [s for s in Status if s not in (Status.OK, Status.REFUSED)]:
        said = status.because("ValueError: no such thing")
        assert status_of(said) is status
        assert reason_of(said) == "ValueError: no such thing"


def test_a_sentence_that_names_no_status_is_a_refusal() -> None:
    cases = [
        "",
        "no oscillation",
        "the search failed: it ended",
    ]
    for said in cases:
        assert status_of(said) is Status.REFUSED
        assert reason_of(said) == said


def test_what_depends_on_a_failure_says_which() -> None:
    failed = Status.FAILED.because("ValueError: x")
    assert following("mode/a/0/viscous", failed) == "not computed: mode/a/0/viscous failed: ValueError: x"
    assert status_of(following("mode/a/0/viscous", failed)) is Status.NOT_COMPUTED
    assert following("mode/a/0/viscous", "no oscillation") == "no oscillation"


def test_whether_a_model_fits() -> None:
    cases = [
        ("fits", Fitting.FITS),
        ("fits, with correlated noise", Fitting.FITS),
        (Fitting.DOES_NOT_FIT.because("outliers"), Fitting.DOES_NOT_FIT),
        ("", None),
    ]
    for said, fitting in cases:
        assert fitting_of(said) is fitting
