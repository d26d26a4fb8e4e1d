"""Run the contest and write its page: `python -m validation.contest ROWS.csv FOLDER [--seed 813 --count 200]`."""

import math
import warnings
from dataclasses import replace
from typing import Any

from bayesdamp.types import Refusal, Signal
from validation import scoring
from validation.contest.page import page
from validation.contest.peers import ROSTER
from validation.contest.records import simulate_record
from validation.scoring import Reply, make_page, page_options
from validation.truth.records import Case


def row_of(record: Case, name: str) -> dict[str, Any]:
    """Let the peer `name` answer a record, and return a row as `scoring.row_of`.

    An exception of the peer counts as a refusal with its message.
    """

    def answer(signal: Signal, amplitudes: tuple[float, ...]) -> Reply:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # warnings of other packages are not our concern
                reply = ROSTER[name](signal.t, signal.y, amplitudes)
        except Refusal:
            raise
        except Exception as fault:
            raise Refusal(" ".join(f"{type(fault).__name__}: {fault}".split())[:200]) from None
        if not all(map(math.isfinite, reply.values)):
            raise Refusal("the damping ratio of the answer is not finite")
        return replace(reply, amplitudes=())  # all peers are judged at the amplitudes that were requested

    return scoring.row_of(record, answer, name)


def main() -> None:
    """Run the command line: answer the records that the table lacks, and write the page."""
    options = page_options(__doc__, seed=813, count=200, workers=1).parse_args()
    records = [simulate_record(options.seed, number) for number in range(options.count)]
    for name in ROSTER:  # import and compile before any record is timed
        row_of(records[0], name)
    todo = {f"{record.name}/{name}": (record, name) for record in records for name in ROSTER}
    make_page(options, todo, row_of, page)


if __name__ == "__main__":
    main()
