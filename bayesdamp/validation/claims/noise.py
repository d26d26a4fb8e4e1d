"""Section 5.5, guideline 4: what to use on noisy data."""

from __future__ import annotations

import math

from bayesdamp.report import words
from bayesdamp.report.results.sweeping import Series
from bayesdamp.validation.claims.judge import NO_RUN, Claim, Judgement, Runs


def _at(found: Series, method: str, stage: str, level: float) -> float:
    errors = found.errors.get((method, stage))
    return errors[found.values.index(level)] if errors and level in found.values else math.nan


def _weak(runs: Runs) -> Judgement:
    along = [s for s in runs.series if s.factor == "noise"]
    if not along:
        return NO_RUN
    parts, places = [], []
    for found in along:
        for level in (1.0, 10.0):
            errors = {m: _at(found, m, "initial", level) for m, stage in found.errors if stage == "initial"}
            ranked = sorted((m for m in errors if math.isfinite(errors[m])), key=lambda m: errors[m])
            if "weak_sindy" not in ranked:
                continue
            place = ranked.index("weak_sindy") + 1
            places.append(place)
            best = words.method(ranked[0])
            parts.append(
                f"{words.model(found.model)} at {level:g} %: place {place} of {len(ranked)} "
                f"({errors['weak_sindy']:.2g} %; best {best} {errors[ranked[0]]:.2g} %)"
            )
    if not places:
        return NO_RUN
    verdict = (
        "holds"
        if max(places) <= 2
        else "holds in part"
        if sum(places) / len(places) <= 3
        else "does not hold"
    )
    return Judgement(verdict, "Rank by initial error: " + "; ".join(parts) + ".")


def _sindy(runs: Runs) -> Judgement:
    along = [s for s in runs.series if s.factor == "noise"]
    if not along:
        return NO_RUN
    better, parts = [], []
    for found in along:
        for level in (1.0, 3.0, 10.0):
            weak, strong = (_at(found, m, "initial", level) for m in ("weak_sindy", "sindy"))
            if math.isfinite(weak) and math.isfinite(strong):
                better.append(weak < strong)
                parts.append(f"{words.model(found.model)} {level:g} %: {weak:.2g} against {strong:.2g} %")
    if not better:
        return NO_RUN
    verdict = "holds" if all(better) else "holds in part" if any(better) else "does not hold"
    return Judgement(verdict, "Weak against strong form: " + "; ".join(parts) + ".")


def _bound(runs: Runs) -> Judgement:
    along = [s for s in runs.series if s.factor == "noise"]
    if not along:
        return NO_RUN
    parts, good = [], []
    for found in along:
        i = found.values.index(1.0) if 1.0 in found.values else len(found.values) // 2
        ratios = {
            m: errors[i] / found.bounds[i]
            for (m, stage), errors in found.errors.items()
            if stage == "refined" and math.isfinite(errors[i]) and found.answers[m, stage][i][0] >= 20
        }
        if ratios:
            good.append(max(ratios.values()) < 1.5)
            parts.append(
                f"{words.model(found.model)} {min(ratios.values()):.2f} to {max(ratios.values()):.2f}"
            )
    if not parts:
        return NO_RUN
    said = "Refined error over the Cramér–Rao bound at 1 % noise: " + "; ".join(parts) + "."
    return Judgement("holds" if all(good) else "does not hold", said)


CLAIMS = (
    Claim("Noisy data: use weak SINDy.", "5.5", _weak),
    Claim("The weak form is better than SINDy in noise, for it takes no derivative.", "3.9", _sindy),
    Claim("Hybrid methods are the most accurate also where there is noise.", "5.2, 6", _bound),
)
