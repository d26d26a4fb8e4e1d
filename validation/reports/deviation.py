"""Write the page on the accuracy of the answer: `python -m validation.reports.deviation ROWS.csv FOLDER`.

Options: `--family 100 --discrepant 60 --dense 20`, the numbers of records. Records count as simulated, so that their
probabilities are not capped.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from bayesdamp.formatting import markdown_table
from bayesdamp.interface.answer import answer
from bayesdamp.types import OK, Refusal, Signal
from bayesdamp.verdict.types import Verdict
from validation.rows import make_page, page_options, where
from validation.scoring import in_columns, probability_of, relation, share, share_covered, three
from validation.truth.records import FAMILY, KINDS, Case, case, name_of

SEED = 903
"""Seed of the records. No threshold and no prior was chosen on them."""
DENSE = 10
"""Factor by which the sampling rate of the records counted by `--dense` is higher."""
NEAR = 0.1
"""Largest relative difference that is allowed between the amplitude of an answered damping ratio and the requested
one."""
LEAST = 1e-12
"""Probabilities of the true sum below this value count as this value, so that the mean of their logarithms is
finite."""
COLUMNS = (
    "case", "kind", "oversample", "mode", "damping", "restoring", "cycles", "nats", "noise_sd", "outcome", "seconds",
    "decided", "named", "relation", "probability", "true_probability", "grade",
    *(f"{what}_{i}" for i in (1, 2, 3) for what in ("amplitude", "ratio", "value", "low", "high")),
    "deviation", "deviation_low", "deviation_high",
)  # fmt: skip
HEADS = {
    "group": "group", "records": "records", "answered": "answered", "decided": "named outright",
    "right": "right, of the named", "more": "true terms and further ones, of the named",
    "wrong": "named wrongly, of all", "coverage": "coverage of the ratio's intervals",
    "half_width": "half width of the intervals", "relative_width": "relative width of the intervals",
    "deviates": "deviates", "log_probability": "mean log P(true)",
    "seconds": "seconds",
}  # fmt: skip
INTRODUCTION = """The records are simulated, with a truth from an independent solver (`validation.truth.records`,
SciPy's DOP853). They are answered under all dampings and restoring laws with linear models, without sampling. No
threshold and no prior was chosen on these seeds. Records of the family are drawn until the true sum is 12 nats or more
ahead of every sum that lacks one of its terms; among arbitrary records, fewer dampings could be named. *none* assumes
that laws hold exactly; *auto* averages over exact and approximate laws. The brackets contain 95 % intervals of the
fractions for this number of records. Widths are relative to those of exact laws on the same record.

Targets. Family, *none*: named outright at least 0.90, right at least 0.97, coverage 0.92 to 0.98.
Family, *auto*: named outright at least 0.75, right at least 0.95, coverage at least 0.95, intervals at most twice as
wide. Discrepant records, *auto*: coverage at least 0.92 (0.90 at ten times the sampling rate); named wrongly and
*deviates* at most 0.05 each.
"""


def row(kind: str, number: int, oversample: int, mode: str) -> dict[str, Any]:
    """Simulate a record, answer it, and return its row.

    kind, number, oversample: the record, as in `validation.truth.records.case`. mode: "none" (the laws hold exactly) or
    "auto" (also approximate laws).
    """

    def quick_verdict(signal: Signal, amplitudes: tuple[float, ...]) -> Verdict:
        return answer(signal, amplitudes, deviation=mode, measured=False, sample=False).verdict

    return row_of(case(kind, SEED, number, oversample), quick_verdict, mode)


def row_of(
    case: Case, answering: Callable[[Signal, tuple[float, ...]], Verdict], mode: str
) -> dict[str, Any]:
    """Answer a record, and return a row with the answer and the truth.

    Parameters
    ----------
    case : Case
        The record and its truth.
    answering : callable
        Function of a record and three amplitudes (rad) that returns the verdict. It raises Refusal if it has none, or
        returns a verdict without damping ratios, whose sentence gives the reason.
    mode : str
        How the answer was requested. The row uses it as a label.

    Returns
    -------
    dict
        Values of `COLUMNS`. After a refusal, the outcome is the text of the refusal.

    Raises
    ------
    ValueError
        The answer gives a damping ratio at an amplitude that was not requested.
    """
    row: dict[str, Any] = {
        "case": case.name, "kind": case.kind, "oversample": case.oversample, "mode": mode, "damping": case.damping,
        "restoring": case.restoring, "cycles": case.cycles, "nats": case.nats, "noise_sd": case.noise_sd,
    }  # fmt: skip
    row |= in_columns(amplitude=case.amplitudes, ratio=map(case.ratio, case.amplitudes))
    began = time.perf_counter()
    try:
        verdict = answering(case.signal, case.amplitudes)
        refusal = verdict.sentence
    except Refusal as fault:
        verdict, refusal = None, str(fault)
    row["seconds"] = time.perf_counter() - began
    if verdict is None or not verdict.damping_ratio:
        return row | {"outcome": refusal, "decided": False}
    row |= {
        "outcome": OK, "decided": bool(verdict.decided), "named": verdict.damping,
        "relation": relation(verdict.damping, case.damping), "probability": verdict.probability,
        "true_probability": probability_of(verdict, case.damping), "grade": str(verdict.grade),
    }  # fmt: skip
    for requested, at in zip(case.amplitudes, verdict.damping_ratio, strict=True):
        if not math.isclose(at.amplitude, requested, rel_tol=NEAR):
            raise ValueError(
                f"{case.name}: the damping ratio is at {at.amplitude:g} rad, but {requested:g} rad was requested"
            )
    # A ratio that is measured without a law may be at a slightly different amplitude.
    value, low, high, amplitude = zip(
        *((at.value, at.low, at.high, at.amplitude) for at in verdict.damping_ratio), strict=True
    )
    row |= in_columns(amplitude=amplitude, ratio=map(case.ratio, amplitude), value=value, low=low, high=high)
    if (deviation := verdict.deviation) is not None:
        row |= {
            "deviation": deviation.value, "deviation_low": deviation.low, "deviation_high": deviation.high,
        }  # fmt: skip
    return row


def scores(rows: pd.DataFrame) -> pd.DataFrame:
    """Score each kind, mode and oversampling among rows from `row_of`, and all discrepancies together.

    Records without an answer count as not decided, and do not enter the other scores.

    Parameters
    ----------
    rows : DataFrame
        Rows with `COLUMNS`.

    Returns
    -------
    DataFrame
        One row for each group, with these columns. Each share is an `Interval`.

        - decided: share of the records whose damping sum is named outright.
        - right: share of these whose named sum is the true one.
        - more: share of these whose named sum has the true terms and others. That can be correct for a record with
          a further damping force.
        - wrong: share of all records whose sum is named outright and is not the true one.
        - coverage: mean share of the three true damping ratios inside their intervals, over the records with
          intervals. Its own interval counts each record once, because the three ratios are not independent.
        - deviates: share of records with that grade.
        - half_width: geometric mean of half the width of an interval over the true ratio.
        - relative_width: geometric mean of the width over that of the same record and amplitude in mode "none".
        - log_probability: mean logarithm of the probability of the true sum, which counts as at least 1e-12.
        - seconds: median time.
    """
    rows = rows.reindex(columns=list(COLUMNS))
    exact = where(rows, mode="none", outcome=OK)
    widths = dict(zip(exact["case"], _widths(exact), strict=True))
    lines = []
    labels = set(zip(rows["mode"], rows["oversample"], strict=True))
    for mode, oversample in sorted(labels, key=lambda label: (label[0] != "none", *label)):
        part = where(rows, mode=mode, oversample=oversample)
        groups = {kind: where(part, kind=kind) for kind in KINDS}
        discrepant = where(part, part["kind"] != FAMILY)
        if len(set(discrepant["kind"])) > 1:
            groups["all discrepancies"] = discrepant
        times = f" ×{oversample}" if oversample > 1 else ""
        lines += [
            {"group": f"{kind}/{mode}{times}", **_score(own, widths)}
            for kind, own in groups.items()
            if len(own)
        ]
    return pd.DataFrame(lines)


def _score(part: pd.DataFrame, exact: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Compute the scores of a group. `exact`: widths of the intervals in mode "none", by the name of the record."""
    answered = where(part, outcome=OK)
    decided = where(answered, decided=True)
    right = len(where(decided, relation="right"))
    widths = _widths(answered)
    others = np.reshape([exact.get(name, np.full(3, math.nan)) for name in answered["case"]], (-1, 3))
    return {
        "records": len(part),
        "answered": len(answered),
        "decided": share(len(decided), len(part)),
        "right": share(right, len(decided)),
        "more": share(len(where(decided, relation="more")), len(decided)),
        "wrong": share(len(decided) - right, len(part)),
        "coverage": share(np.nansum(share_covered(answered)), len(answered)),
        "deviates": share(len(where(answered, grade="deviates")), len(answered)),
        "half_width": _geometric(0.5 * widths / three(answered, "ratio")),
        "relative_width": _geometric(widths / others),
        "log_probability": answered["true_probability"].astype(float).clip(lower=LEAST).map(math.log).mean(),
        "seconds": answered["seconds"].astype(float).median(),
    }


def _widths(rows: pd.DataFrame) -> np.ndarray:
    """Return the widths of the intervals at the three amplitudes of each row, shape (n, 3)."""
    return three(rows, "high") - three(rows, "low")


def _geometric(values: np.ndarray) -> float:
    """Return the geometric mean of the finite values above 0."""
    good = values[np.isfinite(values) & (values > 0)]
    return float(np.exp(np.log(good).mean())) if good.size else math.nan


def page(rows: pd.DataFrame) -> str:
    """Return the page on these rows in Markdown."""
    table = scores(rows)
    sentences = [
        f"If {condition}, 95 % intervals of the damping ratio contain the truth in {line['coverage']} of "
        f"{line['records']} records; the damping is named outright in {line['decided']}, correctly in "
        f"{line['right']} of these."
        for group, condition in (
            ("family/auto", "a law holds exactly"),
            ("all discrepancies/auto", "a law holds only approximately"),
        )
        for line in where(table, group=group).to_dict("records")
    ]

    def cell(name: str, value: Any) -> str:
        if not isinstance(value, float):
            return str(value)
        if math.isnan(value):
            return "–"
        return f"{100 * value:.2g} %" if name == "half_width" else f"{value:.2f}"

    lines = [[cell(name, line[name]) for name in HEADS] for line in table.to_dict("records")]
    return f"""# Laws that hold approximately: how accurate is the answer?

{" ".join(sentences) or "No record belongs to a judged group."}

{INTRODUCTION}
Seed {SEED}:

{markdown_table(list(HEADS.values()), lines)}

`make reports` makes this table again, from a clean working tree; `rows.csv` has every record.
"""


def main() -> None:
    """Run the command line: answer the records that the table lacks, and write the page."""
    parser = page_options(__doc__)
    parser.add_argument("--family", type=int, default=100, help="number of records of the family")
    parser.add_argument("--discrepant", type=int, default=60, help="number of records with a discrepancy")
    parser.add_argument("--dense", type=int, default=20, help="number of these that are also sampled densely")
    options = parser.parse_args()
    kinds = KINDS[1:]
    jobs = [(FAMILY, i, 1, mode) for mode in ("none", "auto") for i in range(options.family)]
    for count, oversample in ((options.discrepant, 1), (options.dense, DENSE)):
        jobs += [(kinds[i % len(kinds)], i // len(kinds), oversample, "auto") for i in range(count)]
    todo = {}
    for kind, number, oversample, mode in jobs:
        todo[f"{name_of(kind, SEED, number, oversample)}/{mode}"] = kind, number, oversample, mode
    make_page(options, "rows.csv", COLUMNS, todo, row, page, key=("case", "mode"))


if __name__ == "__main__":
    main()
