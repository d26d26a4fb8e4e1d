"""Write the page on the accuracy of the answer: `python -m validation.reports.deviation ROWS.csv FOLDER`.

Options: `--family 100 --discrepant 60 --dense 20`, the numbers of records of the family, of those with a discrepancy,
and of those of the latter that are also sampled densely. Records count as simulated, so that their probabilities are
not capped.
"""

from __future__ import annotations

from typing import Any

import pandas as pd

from bayesdamp.interface.answer import answer
from bayesdamp.types import Signal
from validation.rows import make_page, page_options, where
from validation.scoring import (
    COLUMNS,
    KEY,
    Reply,
    coverage,
    groups_of,
    hits_of,
    named,
    reply_of,
    row_of,
    score_table,
)
from validation.truth.records import FAMILY, KINDS, case, name_of

SEED = 903
"""Seed of the records. No threshold and no prior was chosen on them."""
DENSE = 10
"""Factor by which the sampling rate of the records counted by `--dense` is higher."""
ALL = "all discrepancies, auto"
"""Name of the line of the table with all records that have a discrepancy."""
INTRODUCTION = """The records are simulated, with a truth from an independent solver (`validation.truth.records`,
SciPy's DOP853). They are answered under all dampings and restoring laws with linear models, without sampling. No
threshold and no prior was chosen on these seeds. Records of the family are drawn until the true sum is 12 nats or more
ahead of every sum that lacks one of its terms; among arbitrary records, fewer dampings could be named. *none* assumes
that laws hold exactly; *auto* averages over exact and approximate laws. The brackets contain 95 % intervals of the
fractions for this number of records.

Targets. Family, *none*: named outright at least 0.90, right at least 0.97, coverage 0.92 to 0.98.
Family, *auto*: named outright at least 0.75, right at least 0.95, coverage at least 0.95, intervals at most twice as
wide. Discrepant records, *auto*: coverage at least 0.92 (0.90 at ten times the sampling rate); named wrongly and
*deviates* at most 0.05 each.

Named outright: the answer states one damping without reservation. *deviates*: number of answers which warn that the
laws do not hold. P(truth): probability that the answer gives to the true damping.
"""


def row(kind: str, number: int, oversample: int, mode: str) -> dict[str, Any]:
    """Simulate a record, answer it, and return its row.

    kind: "family" or the name of a discrepancy. number: number of the record of this kind. oversample: factor on the
    sampling rate. mode: "none" (the laws hold exactly) or "auto" (also approximate laws).
    """

    def quick_answer(signal: Signal, amplitudes: tuple[float, ...]) -> Reply:
        return reply_of(answer(signal, amplitudes, deviation=mode, measured=False, sample=False).verdict)

    return row_of(case(kind, SEED, number, oversample), quick_answer, mode)


def page(rows: pd.DataFrame) -> str:
    """Return the page in Markdown from the rows of its table.

    The column `peer` has the mode of the answer: "none" (the laws hold exactly) or "auto" (also approximate laws).
    """
    dense = rows["record"].str.endswith(f"-x{DENSE}")
    usual = where(rows, ~dense)
    auto = where(usual, peer="auto")
    groups = {
        "family, none": where(usual, peer="none", group=FAMILY),
        **{f"{kind}, auto": part for kind, part in groups_of(auto, order=KINDS).items()},
        ALL: where(auto, auto["group"] != FAMILY),
        f"{ALL}, ×{DENSE}": where(rows, dense),
    }
    sentences = [
        f"If {condition}, 95 % intervals of the damping ratio contain the truth in {coverage(part)} of "
        f"{len(part)} records; the damping is named outright in {hits_of(named(part), len(part))}, correctly in "
        f"{hits_of(named(part, right=1), named(part))} of these."
        for condition, part in (
            ("a law holds exactly", groups["family, auto"]),
            ("a law holds only approximately", groups[ALL]),
        )
    ]
    scores = (
        "records", "answered", "named outright", "of these correctly", "coverage", "median half width", "deviates",
        "mean P(truth)", "CPU seconds",
    )  # fmt: skip
    return f"""# Laws that hold approximately: how accurate is the answer?

{" ".join(sentences)}

{INTRODUCTION}
Seed {SEED}:

{score_table(groups, *scores)}

`make reports` makes this table again, from a clean working tree; `rows.csv` has every record.
"""


def main() -> None:
    """Run the command line: answer the records that the table lacks, and write the page."""
    options = page_options(__doc__, family=100, discrepant=60, dense=20).parse_args()
    kinds = KINDS[1:]
    jobs = [(FAMILY, i, 1, mode) for mode in ("none", "auto") for i in range(options.family)]
    for count, oversample in ((options.discrepant, 1), (options.dense, DENSE)):
        jobs += [(kinds[i % len(kinds)], i // len(kinds), oversample, "auto") for i in range(count)]
    todo = {
        f"{name_of(kind, SEED, number, times)}/{mode}": (kind, number, times, mode)
        for kind, number, times, mode in jobs
    }
    make_page(options, "rows.csv", COLUMNS, todo, row, page, KEY)


if __name__ == "__main__":
    main()
