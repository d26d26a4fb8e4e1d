"""What tables say of a task reads back as what it was."""

from __future__ import annotations

import pytest

from bayesdamp.outcomes import Status, following, reason_of, status_of


def test_an_outcome_reads_back() -> None:
    for status in [s for s in Status if s not in (Status.OK, Status.REFUSED)]:
        said = status.because("ValueError: no such thing")
        assert status_of(said) is status
        assert reason_of(said) == "ValueError: no such thing"


@pytest.mark.parametrize("said", ["", "no oscillation", "the search failed: it ended"])
def test_a_sentence_that_names_no_status_is_a_refusal(said: str) -> None:
    assert (status_of(said), reason_of(said)) == (Status.REFUSED, said)


def test_what_depends_on_a_failure_says_which() -> None:
    failed = Status.FAILED.because("ValueError: x")
    assert following("mode/a/0/viscous", failed) == "not computed: mode/a/0/viscous failed: ValueError: x"
    assert status_of(following("mode/a/0/viscous", failed)) is Status.NOT_COMPUTED
    assert following("mode/a/0/viscous", "no oscillation") == "no oscillation"
