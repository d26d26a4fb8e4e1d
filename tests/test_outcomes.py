"""The outcome of a task in a table is read back with its status and reason."""

import pytest

from bayesdamp.types import Status, reason_of, status_of


def test_status_and_reason_are_read_from_an_outcome() -> None:
    for status in set(Status) - {Status.OK, Status.REFUSED}:
        outcome = status.because("ValueError: no such thing")
        assert (status_of(outcome), reason_of(outcome)) == (status, "ValueError: no such thing")


@pytest.mark.parametrize("outcome", ["", "no oscillation", "the search failed: it ended"])
def test_a_sentence_without_a_status_is_a_refusal(outcome: str) -> None:
    assert (status_of(outcome), reason_of(outcome)) == (Status.REFUSED, outcome)
