"""What the tables say, put into order and into words: no more than comparisons of their numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bayesdamp.odds import FURTHER_TERM
from bayesdamp.outcomes import Status, status_of
from bayesdamp.report import words
from bayesdamp.report.results.run import Row, Run, rows_of
from bayesdamp.store.contents import ModeContent
from bayesdamp.types import OK, candidate_parts, summed

_FIRST = ("combined", "nested", "bridge", "importance", "laplace")
_SHIPPED = {"viscous": "zeta", "coulomb": "mu_c", "quadratic": "mu_q"}


@dataclass(frozen=True)
class Ranking:
    """The models of one signal by one method, best first. shares: the probability of each damping by every method."""

    method: str
    rows: list[Row]
    shares: dict[str, dict[str, float]]

    @property
    def dampings(self) -> dict[str, float]:
        """The probability of each damping, summed over the restoring laws, the most probable first."""
        return self.shares[self.method]


def damping_of(row: Row) -> str:
    """The damping of a row's candidate, whatever its restoring law."""
    return candidate_parts(row["model"])[0]


def label(row: Row) -> str:
    """The candidate of a row in words."""
    return words.model(row["model"])


def ranking(run: Run, signal: str, repeat: int) -> Ranking | None:
    """Return the ranking by the method that covers the most models; None where no evidence was computed.

    Of several such methods the order is that of trust: a combination, nested sampling, bridge, importance.
    """
    by_method: dict[str, list[Row]] = {}
    for row in rows_of(run.evidence, signal=signal, repeat=repeat):
        if math.isfinite(row["probability"]):
            by_method.setdefault(row["method"], []).append(row)
    if not by_method:
        return None

    def trust(name: str) -> tuple[int, int, str]:
        place = _FIRST.index(name) if name in _FIRST else len(_FIRST)
        return -len(by_method[name]), place, name

    chosen = min(by_method, key=trust)
    ordered = sorted(
        by_method[chosen],
        key=lambda row: (-row["probability"], -np.nan_to_num(row["log_evidence"], nan=-1e300)),
    )
    return Ranking(
        chosen,
        ordered,
        {name: summed({r["model"]: r["probability"] for r in rows}) for name, rows in by_method.items()},
    )


def over_widths(run: Run, signal: str, repeat: int, found: Ranking) -> dict[float, float]:
    """Return the probability of the most probable damping under damping priors so many times as wide, by that factor.

    Summed over the restoring laws, at the widths for which the evidence of all candidates is known; empty where it is
    not. Candidates that were pruned keep their share.
    """
    moved: dict[str, np.ndarray] = {}
    factors = np.empty(0)
    for row in found.rows:
        cell = run.cell("sensitivity", signal, repeat, row["model"], "widths")
        if cell is not None and cell.outcome == OK and cell.arrays:
            factors, logs = cell.arrays["factors"], cell.arrays["log_evidence"]
            change = logs - logs[np.argmin(np.abs(np.log(factors)))]
            moved[row["model"]] = np.where(cell.arrays["trusted"], change, np.nan)
        elif status_of(row["outcome"]) is not Status.PRUNED:
            return {}
    if not moved or len(found.dampings) < 2:
        return {}
    unmoved = np.zeros(factors.size)
    log_p = np.array(
        [np.log(max(r["probability"], 1e-300)) + moved.get(r["model"], unmoved) for r in found.rows]
    )
    p = np.exp(log_p - log_p.max(axis=0))
    leading = next(iter(found.dampings))
    share = p[[damping_of(row) == leading for row in found.rows]].sum(axis=0) / p.sum(axis=0)
    return {float(factor): float(s) for factor, s in zip(factors, share, strict=True) if np.isfinite(s)}


def over_odds(found: Ranking) -> dict[float, dict[str, float]]:
    """Return each damping's probability under half, once and twice the prior factor of a further term, by that factor.

    Empty where all dampings have as many terms.
    """
    counts = {damping_of(row): damping_of(row).count("+") for row in found.rows}
    if len(set(counts.values())) < 2:
        return {}
    shares = {}
    for factor in (0.5 * FURTHER_TERM, FURTHER_TERM, 2 * FURTHER_TERM):
        moved = {d: p * (factor / FURTHER_TERM) ** counts[d] for d, p in found.dampings.items()}
        shares[factor] = {d: p / sum(moved.values()) for d, p in moved.items()}
    return shares


def mode_of(run: Run, signal: str, repeat: int, model: str) -> ModeContent | None:
    """What is stored of a candidate's mode; None where it has none."""
    cell = run.cell("mode", signal, repeat, model)
    return ModeContent.maybe(cell) if cell is not None and cell.outcome == OK else None


def models_by_rank(run: Run, signal: str, repeat: int) -> list[str]:
    """All models of a signal, the most probable first, then in the study's order."""
    found = ranking(run, signal, repeat)
    ranked = [row["model"] for row in found.rows] if found else []
    rows = (*run.estimates, *run.posteriors, *run.evidence, *run.fits)
    seen = {r["model"] for r in rows if r["signal"] == signal} | {
        cell.place.candidate for cell in run.cells("mode", signal, repeat)
    }
    order = [*ranked, *(m for m in run.models if m in seen), *sorted(seen)]
    return list(dict.fromkeys(order))


def models_kept(run: Run, signal: str, repeat: int) -> list[str]:
    """Those of all models that were not pruned, in the same order."""
    found = ranking(run, signal, repeat)
    aside = {r["model"] for r in found.rows if status_of(r["outcome"]) is Status.PRUNED} if found else set()
    return [model for model in models_by_rank(run, signal, repeat) if model not in aside]


def summary_rows(run: Run, signal: str, repeat: int, model: str) -> list[Row]:
    """Return the rows of posteriors.csv of the sampler to quote: NUTS or the first that is `ok`, else the first."""
    rows = rows_of(run.posteriors, signal=signal, repeat=repeat, model=model)
    by_sampler = [rows_of(rows, sampler=s) for s in dict.fromkeys(row["sampler"] for row in rows)]

    def doubted(own: list[Row]) -> bool:
        return any(r["outcome"] != OK for r in own) or not any(math.isfinite(r["mean"]) for r in own)

    best = min(by_sampler, key=lambda own: (doubted(own), own[0]["sampler"] != "nuts"), default=[])
    return [r for r in best if math.isfinite(r["mean"])]


def truth(run: Run, signal: str, parameter: str) -> float:
    """The true value of a simulated signal's parameter, nan where none is known."""
    if not run.simulated(signal):
        return math.nan
    for row in run.estimates:
        if row["signal"] == signal and row["parameter"] == parameter and math.isfinite(row["truth"]):
            return row["truth"]
    return math.nan


def damping_parameters(run: Run) -> dict[str, str]:
    """Each damping term to its coefficient: those that ship, and those that the run says of a user's own."""
    own = run.info.get("damping") or {}
    return {**_SHIPPED, **{term: about["parameter"] for term, about in own.items()}}


def coefficients(run: Run, model: str) -> list[str]:
    """The damping coefficients of a model, by the parameters that its terms are known to have."""
    own = damping_parameters(run)
    return [own[term] for term in candidate_parts(model)[0].split("+") if term in own]
