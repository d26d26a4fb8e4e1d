"""Section 5.5, guideline 4: what to use on noisy data."""

from __future__ import annotations

import math

from bayesdamp.claims.judge import NO_RUN, Claim, Judgement, Runs
from bayesdamp.report import words
from bayesdamp.report.results.places import ahead, interval, places
from bayesdamp.report.results.sweeping import Series


def _errors(found: Series, method: str, level: float) -> dict[int, float]:
    """A method's own errors by repeat at a noise; empty where there are none."""
    each = found.each.get((method, "initial"))
    return each[found.values.index(level)] if each and level in found.values else {}


def _said(found: Series, method: str, level: float) -> str:
    low, high = interval(_errors(found, method, level))
    error = found.errors[method, "initial"][found.values.index(level)]
    return f"{error:.2g} %" + (f" ({low:.2g} to {high:.2g})" if math.isfinite(low) else "")


def _weak(runs: Runs) -> Judgement:
    parts, best, worst = [], [], []
    for found in runs.along_noise:
        for level in (1.0, 10.0):
            if not _errors(found, "weak_sindy", level):
                continue
            order = places(found, "initial", found.values.index(level))
            first, last = order["weak_sindy"]
            best.append(first)
            worst.append(last)
            leading = min(order, key=lambda m: found.errors[m, "initial"][found.values.index(level)])
            place = f"place {first}" if first == last else f"place {first} to {last}"
            parts.append(
                f"{words.model(found.model)} at {level:g} %: {place} of {len(order)}, "
                f"{_said(found, 'weak_sindy', level)}; least {words.method(leading)} {_said(found, leading, level)}"
            )
    if not parts:
        return NO_RUN
    verdict = "holds" if max(worst) <= 2 else "does not hold" if min(best) > 2 else "holds in part"
    told = "Own estimates, places as far as the repeats tell them apart: "
    return Judgement(verdict, told + "; ".join(parts) + ".")


def _sindy(runs: Runs) -> Judgement:
    better, worse, parts = [], [], []
    for found in runs.along_noise:
        for level in (1.0, 3.0, 10.0):
            weak, strong = (_errors(found, m, level) for m in ("weak_sindy", "sindy"))
            if not weak or not strong:
                continue
            better.append(ahead(weak, strong))
            worse.append(ahead(strong, weak))
            said = "better" if better[-1] else "worse" if worse[-1] else "not told apart"
            pair = f"{_said(found, 'weak_sindy', level)} against {_said(found, 'sindy', level)}"
            parts.append(f"{words.model(found.model)} {level:g} %: {pair}, {said}")
    if not better:
        return NO_RUN
    verdict = "holds" if all(better) else "holds in part" if any(better) else "does not hold"
    return Judgement(verdict, "Weak against strong form: " + "; ".join(parts) + ".")


def _bound(runs: Runs) -> Judgement:
    parts, good = [], []
    for found in runs.along_noise:
        pooled = {m: _over_bound(found, m) for m, stage in found.errors if stage == "refined"}
        ratios = {m: ratio for m, (ratio, answers) in pooled.items() if answers >= FEWEST}
        if ratios:
            good.append(max(ratios.values()) < 1.5)
            parts.append(
                f"{words.model(found.model)} {min(ratios.values()):.2f} to {max(ratios.values()):.2f}"
            )
    if not parts:
        return NO_RUN
    said = "Refined error over the Cramér–Rao bound, over all levels of noise: " + "; ".join(parts) + "."
    return Judgement("holds" if all(good) else "does not hold", said)


FEWEST = 20
"""Answers from which a root mean square is good to a sixth."""


def _over_bound(found: Series, method: str) -> tuple[float, int]:
    """Root mean square of a method's refined errors over the bound of their level, and of how many."""
    each = found.each[method, "refined"]
    squares = [
        (e / bound) ** 2
        for errors, bound in zip(each, found.bounds, strict=True)
        if math.isfinite(bound)
        for e in errors.values()
    ]
    return (math.sqrt(sum(squares) / len(squares)) if squares else math.nan, len(squares))


CLAIMS = (
    Claim("Noisy data: use weak SINDy.", "5.5", _weak),
    Claim("The weak form is better than SINDy in noise, for it takes no derivative.", "3.9", _sindy),
    Claim("Hybrid methods are the most accurate also where there is noise.", "5.2, 6", _bound),
)
