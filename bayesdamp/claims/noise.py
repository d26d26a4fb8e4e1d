"""Section 5.5, guideline 4: the choice of a method for noisy data."""

from __future__ import annotations

import math

from bayesdamp.claims.judge import NO_RUN, Claim, Judgement, Runs
from bayesdamp.report import words
from bayesdamp.report.results.sweeping import Series, ahead, interval, places

FEWEST = 20
"""Number of errors from which a root mean square is accurate to a sixth."""


def _errors(along: Series, method: str, level: float) -> dict[int, float]:
    """Return the errors of a method's own estimates by repeat at a noise level; empty if there are none."""
    each = along.each.get((method, "initial"))
    return each[along.values.index(level)] if each and level in along.values else {}


def _size(along: Series, method: str, level: float) -> str:
    """Return the root mean square error of a method's own estimates, with its interval."""
    low, high = interval(_errors(along, method, level))
    error = along.errors[method, "initial"][along.values.index(level)]
    return f"{error:.2g} %" + (f" ({low:.2g} to {high:.2g})" if math.isfinite(low) else "")


def _weak(runs: Runs) -> Judgement:
    parts, best, worst = [], [], []
    for along in runs.along_noise:
        for level in (1.0, 10.0):
            if not _errors(along, "weak_sindy", level):
                continue
            order = places(along, "initial", along.values.index(level))
            first, last = order["weak_sindy"]
            best.append(first)
            worst.append(last)
            leading = min(order, key=lambda m: along.errors[m, "initial"][along.values.index(level)])
            place = f"place {first}" if first == last else f"place {first} to {last}"
            parts.append(
                f"{words.model(along.model)} at {level:g} %: {place} of {len(order)}, "
                f"{_size(along, 'weak_sindy', level)}; smallest {words.method(leading)} {_size(along, leading, level)}"
            )
    if not parts:
        return NO_RUN
    verdict = "holds" if max(worst) <= 2 else "does not hold" if min(best) > 2 else "holds in part"
    return Judgement(verdict, f"Own estimates, with the places that the repeats allow: {'; '.join(parts)}.")


def _sindy(runs: Runs) -> Judgement:
    better, parts = [], []
    for along in runs.along_noise:
        for level in (1.0, 3.0, 10.0):
            weak, strong = (_errors(along, m, level) for m in ("weak_sindy", "sindy"))
            if not weak or not strong:
                continue
            better.append(ahead(weak, strong))
            result = (
                "better" if better[-1] else "worse" if ahead(strong, weak) else "not significantly different"
            )
            pair = f"{_size(along, 'weak_sindy', level)} against {_size(along, 'sindy', level)}"
            parts.append(f"{words.model(along.model)} {level:g} %: {pair}, {result}")
    if not better:
        return NO_RUN
    verdict = "holds" if all(better) else "holds in part" if any(better) else "does not hold"
    return Judgement(verdict, f"Weak against strong form: {'; '.join(parts)}.")


def _bound(runs: Runs) -> Judgement:
    parts, good = [], []
    for along in runs.along_noise:
        ratios = []
        for method, stage in along.errors:
            if stage != "refined":
                continue
            squares = [
                (e / bound) ** 2
                for errors, bound in zip(along.each[method, stage], along.bounds, strict=True)
                if math.isfinite(bound)
                for e in errors.values()
            ]
            if len(squares) >= FEWEST:
                ratios.append(math.sqrt(sum(squares) / len(squares)))
        if ratios:
            good.append(max(ratios) < 1.5)
            parts.append(f"{words.model(along.model)} {min(ratios):.2f} to {max(ratios):.2f}")
    if not parts:
        return NO_RUN
    measured = f"Refined error over the Cramér–Rao bound, over all noise levels: {'; '.join(parts)}."
    return Judgement("holds" if all(good) else "does not hold", measured)


CLAIMS = (
    Claim("Noisy data: use weak SINDy.", "5.5", _weak),
    Claim("In noise, the weak form is better than SINDy because it uses no derivative.", "3.9", _sindy),
    Claim("Hybrid methods are the most accurate in noise too.", "5.2, 6", _bound),
)
