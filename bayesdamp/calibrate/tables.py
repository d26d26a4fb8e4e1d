"""Build the tables and summaries of a calibration and of a model recovery, with a p value for every test.

A calibration draws parameters from the prior and simulates a record with them. If the posterior is right, the rank of a
true parameter among independent posterior draws is then uniform (Talts, Betancourt, Simpson, Vehtari and Gelman, arXiv
1804.06788). The rank is also uniform over any selection of records that depends on the record alone, because the
posterior is conditional on the record.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import binom, binomtest, kstest, norm

from bayesdamp.calibrate.ranks import LIKELIHOOD
from bayesdamp.config import Study
from bayesdamp.store.results import ChunkContent, RanksContent, RecoveryContent, TaskResult
from bayesdamp.types import OK

LEVELS = (0.5, 0.8, 0.95)
"""Probabilities of the parameter intervals that are tested: each should contain the true value in this fraction of
records."""
EDGES = (0.0, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0)
"""Edges of the bins into which the records of a model recovery are sorted: by the probability of the most probable
model of each record."""
FALSE_ALARM = 0.01
"""Probability that any test in a table has the verdict "wrong" although everything is correct (conventional)."""
CLASSICAL = "refined estimate"
"""Name of the trajectory fit (the refined estimate) in the column "method". Its intervals, a multiple of its standard
errors, are tested too."""
COLUMNS = (
    "model", "method", "parameter", "check", "level", "records", "without", "value", "low", "high", "p", "p_holm",
    "verdict",
)  # fmt: skip
"""Columns of calibration.csv; the docstring of `calibration_rows` explains them."""
RANK_COLUMNS = ("model", "sampler", "parameter", "ranks")
"""Columns of ranks.csv. The column `ranks` contains the ranks of the true value in all records with draws, separated by
spaces."""
RECORD_COLUMNS = ("record", "noise", "cycles", "model", "outcome", "doubts")
"""First columns of recovery.csv: the number of the record, its noise (fraction of the reference amplitude), number of
cycles, true model, outcome (`ok`, or why it is not used), and the number of models whose evidence is doubtful (empty if
the record is not used). They are followed by a column for each sum of damping terms with its probability."""

Row = dict[str, Any]
Results = Mapping[str, Sequence[TaskResult]]


def _join(chunks: Sequence[TaskResult], name: str) -> np.ndarray:
    """Return the array `name` in the results of all tasks of a series, joined along its first axis (records)."""
    return np.concatenate([c.arrays[name] for c in chunks])


def _adjust(family: Iterable[Row]) -> list[Row]:
    """Add to each row of a family of tests its p value adjusted by Holm's method, as `p_holm`; return the rows.

    The adjustment is for the number of tests in the family. The given rows are changed.
    """
    rows = list(family)
    for row, adjusted in zip(rows, holm([r["p"] for r in rows]), strict=True):
        row["p_holm"] = float(adjusted)
    return rows


def calibration_rows(study: Study, results: Results) -> list[Row]:
    """Return the rows of calibration.csv; each row is one test.

    For each model, sampler and parameter (also the log likelihood) there is a test of the ranks, and a test of coverage
    for each level of intervals (`LEVELS`). Further rows test the coverage of the intervals of the refined estimates
    (trajectory fits). Samplers and refined estimates are two families of tests, each with its own adjusted p values
    (`p_holm`). results: results of tasks by series.

    Values in a row:

    - records: number of tested records. without: number of further records, which have no interval (refined estimates
      without a standard error). level: probability of the intervals (only for coverage).
    - value: for "ranks" the largest difference, with its sign, of their distribution function from the uniform one; for
      "coverage" the fraction of intervals that contain the true value.
    - low, high: range that contains this fraction with 99 % probability if the intervals are right (only for coverage).
    - p: two-sided p value, nan if there are no records.
    - verdict: "wrong" if p_holm is below `FALSE_ALARM`, "not tested" if it is nan, else "passes".
    """
    rows, classical = list[Row](), list[Row]()
    for model, sampler, name, ranks, below in _ranks(study, results):
        head = {"model": model, "method": sampler, "parameter": name}
        value, p = uniformity_test(ranks, study.calibration.draws)
        rows.append({**head, "check": "ranks", "records": ranks.size, "without": 0, "value": value, "p": p})
        inside = np.abs(below - 0.5)
        rows += [{**head, **_coverage_row(inside <= 0.5 * level, level)} for level in LEVELS]
    for chunks in results.values():
        good = np.concatenate([RanksContent.of(c).accepted for c in chunks])
        content = RanksContent.of(chunks[0])
        truth, value, stderr = (_join(chunks, part)[good] for part in ("truth", "value", "stderr"))
        for k, name in enumerate(content.names):
            if name == LIKELIHOOD or not np.any(np.isfinite(value[:, k])):
                continue
            has_error = np.isfinite(stderr[:, k]) & (stderr[:, k] > 0)
            away = np.abs(value[:, k] - truth[:, k])[has_error] / stderr[has_error, k]
            head = {"model": content.model, "method": CLASSICAL, "parameter": name}
            for level in LEVELS:  # intervals of norm.ppf(...) standard errors, from the Hessian
                inside, without = away <= norm.ppf(0.5 + 0.5 * level), int(np.sum(~has_error))
                classical.append({**head, **_coverage_row(inside, level, without)})
    rows = _adjust(rows) + _adjust(classical)
    for row in rows:
        p = row["p_holm"]
        row |= {k: float(f"{row[k]:.6g}") for k in ("value", "low", "high", "p", "p_holm") if k in row}
        row["verdict"] = "not tested" if np.isnan(p) else "wrong" if p < FALSE_ALARM else "passes"
    return rows


def _ranks(study: Study, results: Results) -> Iterator[tuple[str, str, str, np.ndarray, np.ndarray]]:
    """Yield the ranks of the true value among posterior draws, for each model, sampler and parameter.

    The log likelihood counts as a parameter. Each item contains the names of model, sampler and parameter, the ranks,
    (n,), and the fractions, (n,), for the n records that have draws of this sampler. A rank is the number of thinned
    draws below the true value; a fraction is the share of all draws below it.
    """
    for chunks in results.values():
        content = RanksContent.of(chunks[0])
        ranks, below = _join(chunks, "ranks"), _join(chunks, "below")
        for s, sampler in enumerate(study.calibration.samplers):
            for k, name in enumerate(content.names):
                counts = ranks[:, s, k] >= 0
                yield content.model, sampler, name, ranks[counts, s, k], below[counts, s, k]


def _coverage_row(inside: np.ndarray, level: float, without: int = 0) -> Row:
    """Return the row of a test of coverage: do intervals of probability `level` contain the truth in this fraction?

    inside, (n,): whether each interval contains the truth. without: number of records without an interval, which are
    not tested. The row contains the number of tested records, the fraction of intervals that contain the truth (value),
    the range of this fraction with 99 % probability if the intervals are right (low, high), and the p value of the
    exact binomial test.
    """
    n, hits = inside.size, int(inside.sum())
    low, high = binom.interval(1 - FALSE_ALARM, n, level) if n else (np.nan, np.nan)
    return {
        "check": "coverage",
        "level": level,
        "records": n,
        "without": without,
        "value": hits / n if n else np.nan,
        "low": float(low) / n if n else np.nan,
        "high": float(high) / n if n else np.nan,
        "p": float(binomtest(hits, n, level).pvalue) if n else np.nan,
    }


def rank_rows(study: Study, results: Results) -> Iterator[Row]:
    """Yield the rows of ranks.csv: the ranks of the true values among thinned posterior draws.

    A row contains the ranks of all records with draws, in the order of the records, for one model, sampler and
    parameter (or the log likelihood): in one field, separated by spaces.
    """
    for model, sampler, name, ranks, _ in _ranks(study, results):
        text = " ".join(map(str, ranks.tolist()))
        yield {"model": model, "sampler": sampler, "parameter": name, "ranks": text}


def calibration_summary(study: Study, results: Results, rows: Sequence[Row]) -> Row:
    """Return the summary of a calibration for run.json: counts by model, verdicts, and bands for the figures.

    results: results of tasks by series. rows: the rows of calibration.csv. The bands are for histograms of ranks: for
    each number of records, the range that contains the number of ranks in a bin with 99 % probability if ranks are
    uniform.
    """
    table, counts = study.calibration, {}
    for chunks in results.values():
        contents = [RanksContent.of(c) for c in chunks]
        counts[contents[0].model] = {
            **_outcomes(contents),
            "samplers": {
                s: dict(Counter(o for c in contents for o in c.sampler_outcomes[s] if o))
                for s in table.samplers
            },
            "seconds": {k: sum(c.seconds[k] for c in contents) for k in ("record", *table.samplers)},
        }
    numbers = {r["records"] for r in rows if r["check"] == "ranks" and r["records"]}
    bands = {str(n): binom.interval(1 - FALSE_ALARM, n, 1 / table.bins) for n in sorted(numbers)}
    families = {}
    for family, classical in {"posterior": False, "classical": True}.items():
        verdicts = Counter(r["verdict"] for r in rows if (r["method"] == CLASSICAL) is classical)
        families[family] = {"tests": verdicts["passes"] + verdicts["wrong"], "wrong": verdicts["wrong"]}
    return {
        "counts": counts,
        "families": families,
        "bands": bands,
        "alarm": FALSE_ALARM,
        "bins": table.bins,
        "draws": table.draws,
    }


def _outcomes(contents: Iterable[ChunkContent]) -> Row:
    """Count the simulated records of tasks: all (`tried`), the usable ones (`counted`), and the others (`refused`).

    `refused` contains the number of records for each reason. contents: the stored contents of the tasks' results.
    """
    outcomes = Counter(o for c in contents for o in c.outcomes)
    return {"tried": sum(outcomes.values()), "counted": outcomes.pop(OK, 0), "refused": dict(outcomes)}


def recovery_table(chunks: Sequence[TaskResult]) -> tuple[tuple[str, ...], list[Row]]:
    """Return columns and rows of recovery.csv: a row for each simulated record, with the probability of each model.

    The probabilities of a record that is not used are NaN. chunks: results of all tasks.
    """
    rows: list[Row] = []
    models = RecoveryContent.of(chunks[0]).models
    for chunk in chunks:
        content, arrays = RecoveryContent.of(chunk), chunk.arrays
        for i, outcome in enumerate(content.outcomes):
            noise, cycles = arrays["design"][i]
            doubts = sum(evidence != OK for evidence in content.evidence_outcomes[i])
            row = {
                "record": content.first + i,
                "noise": float(noise),
                "cycles": float(cycles),
                "model": models[arrays["model"][i]],
                "outcome": outcome,
                "doubts": doubts if outcome == OK else None,
            }
            shares = zip(models, arrays["probability"][i], strict=True)
            rows.append({**row, **{model: float(f"{p:.6g}") for model, p in shares}})
    return (*RECORD_COLUMNS, *models), rows


def recovery_summary(chunks: Sequence[TaskResult]) -> Row:
    """Return the summary of a model recovery for run.json.

    Its entry `recovery` contains the numbers of tried and counted records, the confusion matrix (a row for each true
    model, a column for each most probable model), the tests of the models' probabilities, and the mean natural log of
    the probability of the true model (`log_score`), also as it is expected if the probabilities are right
    (`log_score_expected`). chunks: results of all tasks.
    """
    contents = [RecoveryContent.of(c) for c in chunks]
    models = contents[0].models
    good = np.concatenate([c.accepted for c in contents]).astype(bool)
    truth, p = (_join(chunks, name)[good] for name in ("model", "probability"))
    evidences = [o for c in contents for row, ok in zip(c.evidence_outcomes, c.accepted) if ok for o in row]
    top = p.argmax(axis=1)
    hit, highest = top == truth, p.max(axis=1)
    logs = np.log(np.maximum(p, 1e-300))
    confusion = np.zeros((len(models), len(models)), int)
    np.add.at(confusion, (truth, top), 1)
    recovery = {
        "models": models,
        **_outcomes(contents),
        "evidences": len(evidences),
        "doubtful": sum(outcome != OK for outcome in evidences),
        "confusion": confusion,
        "hits": _hits(hit, highest),
        "bins": _adjust(_bins(hit, highest)),
        "log_score": float(np.mean(logs[np.arange(truth.size), truth])) if truth.size else np.nan,
        "log_score_expected": float(np.mean(np.sum(p * logs, axis=1))) if truth.size else np.nan,
        "seconds": sum(c.seconds for c in chunks),
    }
    return {"alarm": FALSE_ALARM, "recovery": recovery}


def _hits(hit: np.ndarray, p: np.ndarray) -> Row:
    """Return how often the most probable model is the true one (hits), and how often it should be.

    hit, (n,): whether the most probable model of each record is the true one. p, (n,): its probability. In the result,
    `expected` is the sum of these probabilities, and `excess` is the number of hits minus this sum. If the
    probabilities are right, the standard deviation of the excess is `sd`, and its 99 % range is `low` to `high`.
    share_low, share_high: 95 % interval of the fraction of hits. p: two-sided p value of the number of hits.
    """
    n, hits = hit.size, int(hit.sum())
    low, high = hits_band(p, 1 - FALSE_ALARM)
    share = binomtest(hits, n).proportion_ci(0.95, "exact") if n else None
    return {
        "records": n,
        "hits": hits,
        "expected": float(p.sum()),
        "excess": float(hits - p.sum()),
        "low": low - float(p.sum()),
        "high": high - float(p.sum()),
        "sd": float(np.sqrt(np.sum(p * (1 - p)))),
        "p": hits_p(hits, p),
        "share_low": share.low if share else np.nan,
        "share_high": share.high if share else np.nan,
    }


def _bins(hit: np.ndarray, p: np.ndarray) -> Iterator[Row]:
    """Yield a row for each bin of `EDGES` that contains records: those with lower edge < `p` ≤ upper edge.

    hit, (n,): whether the most probable model of each record is the true one. p, (n,): the probability of this model. A
    row contains the edges (from, to), the number of records, their mean `p` (probability), the fraction of them whose
    most probable model is the true one (share), the range of this fraction if the probabilities are right (low, high),
    and a two-sided p value. With 99 % probability all fractions are in their ranges (Bonferroni).
    """
    bin_of = np.clip(np.searchsorted(EDGES, p, side="left") - 1, 0, len(EDGES) - 2)
    edges, used = list(pairwise(EDGES)), np.unique(bin_of)
    for k in used:
        inside = bin_of == k
        least, most = hits_band(p[inside], 1 - FALSE_ALARM / used.size)
        n = int(inside.sum())
        yield {
            "from": edges[k][0],
            "to": edges[k][1],
            "records": n,
            "probability": float(p[inside].mean()),
            "share": float(hit[inside].mean()),
            "low": least / n,
            "high": most / n,
            "p": hits_p(int(hit[inside].sum()), p[inside]),
        }


def uniformity_test(ranks: np.ndarray, draws: int) -> tuple[float, float]:
    """Test whether ranks, (n,), whole numbers from 0 to `draws`, are uniform; return the statistic and the p value.

    The statistic is that of Kolmogorov and Smirnov: the largest difference, with its sign, of the ranks' distribution
    function from the uniform one. Its distribution is exact for any n, whereas the χ² test needs several ranks in each
    bin. Each rank is replaced by the middle of its part, 1/(draws + 1), of the interval from 0 to 1. This changes the
    statistic by at most half of that part: 0.002 for 255 draws. Both results are nan if n is 0.
    """
    if not ranks.size:
        return np.nan, np.nan
    test = kstest((ranks + 0.5) / (draws + 1), "uniform")
    return float(test.statistic * test.statistic_sign), float(test.pvalue)


def holm(tests: Sequence[float]) -> np.ndarray:
    """Return the p values of k tests adjusted by Holm's method, (k,), in the order of the tests.

    If all tests with adjusted p values below α are rejected, the probability of any false rejection is at most α. A
    test without a p value (nan) keeps nan and does not count.
    """
    p = np.asarray(tests, float)
    adjusted = np.full(p.size, np.nan)
    tested = np.flatnonzero(np.isfinite(p))
    order = tested[np.argsort(p[tested], kind="stable")]
    adjusted[order] = np.minimum(np.maximum.accumulate(np.arange(order.size, 0, -1) * p[order]), 1.0)
    return adjusted


def hits_distribution(p: np.ndarray) -> np.ndarray:
    """Return the probabilities of 0, 1, ..., n hits, (n + 1,).

    A hit is an event that occurs. The n events are independent and have the probabilities p, (n,).
    """
    distribution = np.ones(1)
    for probability in np.clip(p, 0.0, 1.0):
        distribution = np.convolve(distribution, [1.0 - probability, probability])
    return distribution


def hits_p(hits: int, p: np.ndarray) -> float:
    """Return the two-sided p value of a number of hits among independent events with probabilities p, (n,).

    It is nan if there are no events.
    """
    if not p.size:
        return float("nan")
    mass = hits_distribution(p)
    return float(min(1.0, 2 * min(mass[: hits + 1].sum(), mass[hits:].sum())))


def hits_band(p: np.ndarray, probability: float) -> tuple[int, int]:
    """Return the smallest and the largest number of hits in a range that has at least the given probability.

    A hit is an event that occurs; the n events are independent and have the probabilities p, (n,). Fewer hits than in
    the range have at most the probability (1 − probability)/2; the same applies to more hits.
    """
    cumulative = np.cumsum(hits_distribution(p))
    tail = 0.5 * (1.0 - probability)
    return int(np.searchsorted(cumulative, tail, side="right")), int(np.searchsorted(cumulative, 1.0 - tail))
