"""Read a run's tables: rank models, sum probabilities, and look up modes, summaries and true values."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bayesdamp.odds import FURTHER_TERM
from bayesdamp.outcomes import Status, status_of
from bayesdamp.report.results.run import Row, RunFolder, rows_of
from bayesdamp.store.contents import ModeContent
from bayesdamp.types import OK, candidate_parts, summed

_TRUSTED = ("combined", "nested", "bridge", "importance", "laplace")
"""Evidence methods, the most trusted first."""
_SHIPPED = {"viscous": "zeta", "coulomb": "mu_c", "quadratic": "mu_q"}


@dataclass(frozen=True)
class EvidenceRanking:
    """The models of one signal by one evidence method, best first.

    `shares` contains the probability of each damping by every method.
    """

    method: str
    rows: list[Row]
    shares: dict[str, dict[str, float]]

    @property
    def dampings(self) -> dict[str, float]:
        """The probability of each damping, summed over the restoring laws, the most probable first."""
        return self.shares[self.method]


def damping_of(row: Row) -> str:
    """Return the damping of a row's candidate, without its restoring law."""
    return candidate_parts(row["model"])[0]


def ranking(run: RunFolder, signal: str, repeat: int) -> EvidenceRanking | None:
    """Rank the models by the evidence method that covers most of them; None if no evidence was computed.

    If several methods cover as many models, the most trusted one is used: a combination, nested sampling, bridge
    sampling, importance sampling.
    """
    by_method: dict[str, list[Row]] = {}
    for row in rows_of(run.evidence, signal=signal, repeat=repeat):
        if math.isfinite(row["probability"]):
            by_method.setdefault(row["method"], []).append(row)
    if not by_method:
        return None

    def trust(name: str) -> tuple[int, int, str]:
        place = _TRUSTED.index(name) if name in _TRUSTED else len(_TRUSTED)
        return -len(by_method[name]), place, name

    chosen = min(by_method, key=trust)
    ordered = sorted(
        by_method[chosen],
        key=lambda row: (-row["probability"], -np.nan_to_num(row["log_evidence"], nan=-1e300)),
    )
    shares = {name: summed({r["model"]: r["probability"] for r in rows}) for name, rows in by_method.items()}
    return EvidenceRanking(chosen, ordered, shares)


def over_widths(run: RunFolder, signal: str, repeat: int, ranked: EvidenceRanking) -> dict[float, float]:
    """Return the probability of the most probable damping under wider and narrower damping priors.

    It is summed over the restoring laws, and given for the widths at which the evidence of all candidates is known.
    Candidates that were pruned keep their share.

    Parameters
    ----------
    run, signal, repeat
        The record.
    ranked
        Its ranking.

    Returns
    -------
    dict
        Factor on the priors' width to probability; empty if the evidence at other widths is not known.
    """
    changes: dict[str, np.ndarray] = {}
    factors = np.empty(0)
    for row in ranked.rows:
        cell = run.cell("sensitivity", signal, repeat, row["model"], "widths")
        if cell is not None and cell.outcome == OK and cell.arrays:
            factors, logs = cell.arrays["factors"], cell.arrays["log_evidence"]
            change = logs - logs[np.argmin(np.abs(np.log(factors)))]
            changes[row["model"]] = np.where(cell.arrays["trusted"], change, np.nan)
        elif status_of(row["outcome"]) is not Status.PRUNED:
            return {}
    if not changes or len(ranked.dampings) < 2:
        return {}
    unchanged = np.zeros(factors.size)
    log_p = np.array(
        [np.log(max(r["probability"], 1e-300)) + changes.get(r["model"], unchanged) for r in ranked.rows]
    )
    p = np.exp(log_p - log_p.max(axis=0))
    leading = next(iter(ranked.dampings))
    share = p[[damping_of(row) == leading for row in ranked.rows]].sum(axis=0) / p.sum(axis=0)
    return {float(factor): float(s) for factor, s in zip(factors, share, strict=True) if np.isfinite(s)}


def over_odds(ranked: EvidenceRanking) -> dict[float, dict[str, float]]:
    """Return each damping's probability under half, once and twice the prior factor of a further term, by that factor.

    Empty if all dampings have the same number of terms.
    """
    counts = {damping_of(row): damping_of(row).count("+") for row in ranked.rows}
    if len(set(counts.values())) < 2:
        return {}
    shares = {}
    for factor in (0.5 * FURTHER_TERM, FURTHER_TERM, 2 * FURTHER_TERM):
        weights = {d: p * (factor / FURTHER_TERM) ** counts[d] for d, p in ranked.dampings.items()}
        shares[factor] = {d: weight / sum(weights.values()) for d, weight in weights.items()}
    return shares


def mode_of(run: RunFolder, signal: str, repeat: int, model: str) -> ModeContent | None:
    """Return the stored mode of a candidate; None if it has none."""
    cell = run.cell("mode", signal, repeat, model)
    return ModeContent.maybe(cell) if cell is not None and cell.outcome == OK else None


def models_by_rank(run: RunFolder, signal: str, repeat: int) -> list[str]:
    """Return all models of a signal: first the ranked ones, the most probable first, then in the study's order."""
    ranked = ranking(run, signal, repeat)
    rows = (*run.estimates, *run.posteriors, *run.evidence, *run.fits)
    models = {r["model"] for r in rows if r["signal"] == signal}
    models |= {cell.place.candidate for cell in run.cells("mode", signal, repeat)}
    first = [row["model"] for row in ranked.rows] if ranked else []
    return list(dict.fromkeys([*first, *(m for m in run.models if m in models), *sorted(models)]))


def models_kept(run: RunFolder, signal: str, repeat: int) -> list[str]:
    """Return the models that were not pruned, in the order of `models_by_rank`."""
    ranked = ranking(run, signal, repeat)
    rows = ranked.rows if ranked else []
    pruned = {r["model"] for r in rows if status_of(r["outcome"]) is Status.PRUNED}
    return [model for model in models_by_rank(run, signal, repeat) if model not in pruned]


def summary_rows(run: RunFolder, signal: str, repeat: int, model: str) -> list[Row]:
    """Return the rows of posteriors.csv of the sampler to quote: NUTS or the first that is `ok`, else the first."""
    rows = rows_of(run.posteriors, signal=signal, repeat=repeat, model=model)
    by_sampler = [rows_of(rows, sampler=s) for s in dict.fromkeys(row["sampler"] for row in rows)]

    def doubted(own: list[Row]) -> bool:
        return any(r["outcome"] != OK for r in own) or not any(math.isfinite(r["mean"]) for r in own)

    best = min(by_sampler, key=lambda own: (doubted(own), own[0]["sampler"] != "nuts"), default=[])
    return [r for r in best if math.isfinite(r["mean"])]


def truth(run: RunFolder, signal: str, parameter: str) -> float:
    """Return the true value of a simulated signal's parameter, nan if it is not known."""
    if not run.simulated(signal):
        return math.nan
    for row in run.estimates:
        if row["signal"] == signal and row["parameter"] == parameter and math.isfinite(row["truth"]):
            return row["truth"]
    simulated = run.simulation(signal).get("truth") or {}
    return float(simulated.get(parameter, math.nan))


def damping_parameters(run: RunFolder) -> dict[str, str]:
    """Return the coefficient of each damping term: of the package's own terms, and of a user's terms in run.json."""
    added = run.info.get("damping") or {}
    return {**_SHIPPED, **{term: about["parameter"] for term, about in added.items()}}


def coefficients(run: RunFolder, model: str) -> list[str]:
    """Return the damping coefficients of a model, for the terms whose coefficient is known."""
    parameters = damping_parameters(run)
    return [parameters[term] for term in candidate_parts(model)[0].split("+") if term in parameters]
