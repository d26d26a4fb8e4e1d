"""From a record of an envelope to its damping."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayesdamp.envelope.model.candidates import (
    Blocks,
    Candidate,
    derivatives,
    fit_rates,
    warp_columns,
    weigh,
    weigh_power,
)
from bayesdamp.envelope.model.deviation import KNOTS, knot_covariance
from bayesdamp.envelope.model.laws import POWERS, SUMS, coefficients, decay, rate
from bayesdamp.envelope.model.noise import SHARES, SLOW, Noise, infer_noise
from bayesdamp.envelope.model.posterior import DRIFT, SENSOR, Draws, draw
from bayesdamp.envelope.model.release import held_blocks
from bayesdamp.envelope.records.one_law import blocks
from bayesdamp.envelope.records.record import EnvelopeRecord
from bayesdamp.envelope.records.window import ABOVE_FLOOR, Window, find_window
from bayesdamp.envelope.results import (
    AtAmplitude,
    Coefficient,
    Curve,
    Cut,
    EnvelopeResult,
    Estimated,
    Range,
)
from bayesdamp.envelope.words import FEW, no_decay, remarks, sentence
from bayesdamp.types import Refusal

NEPER = 20.0 / np.log(10.0)
"""dB."""
MOST = 100
"""Means of readings that are weighed: enough for what a decay of 40 dB and its noise are made of."""
DECIDED = 0.95
APPROXIMATE = 0.25
"""Deviation (95 % bound) up to which a sum is said to hold approximately."""
POWER_LAW = np.log(20.0)
"""Log Bayes factor from which a power law is said to describe a decay better than every sum."""
ASKED = (0.15, 0.5, 0.85)
"""Where in the decay's fall in dB rates are quoted."""
CHECKED = 0.1
"""Share of the decay at its start that is held against the rest."""
SURPRISE = 4.5
"""Standard deviations at which it is none of the decay (of 5 normal ones, one in 30,000 is)."""
HOPELESS = 25.0
"""Nats behind the best with the first noise at which a sum is not weighed with the others: those are worth few."""
TRIES = 3
SHORTER = 0.05
"""Share of a decay by which one of which no floor is seen has to be shorter to be cut where its scatter shows one."""
SPARSE = 40
"""Readings below which none is left out for standing off."""


def analyse(record: EnvelopeRecord, window: Window | None = None, seed: int = 0) -> EnvelopeResult:
    """The damping of an envelope with its uncertainty; a refusal is a result of grade "no_free_decay".

    window: the free decay, else it is found. seed: of the draws that intervals are read from.
    """
    try:
        chosen = window or find_window(record.t, record.level)
    except Refusal as refusal:
        return EnvelopeResult(record.name, "no_free_decay", no_decay(record.name, str(refusal)))
    first, stop = chosen.start, chosen.stop
    found, reference = _blocks(record, chosen, first)
    for _ in range(TRIES):
        held = held_blocks(found) if window is None and stop - first >= SPARSE else 0
        if held == 0:
            break
        first += held * (stop - first) // found.t.size
        found, reference = _blocks(record, chosen, first)
    noises, inverse, later, end = _noises(found)
    for _ in range(TRIES):
        if window is not None or chosen.stop - first < SPARSE:
            break
        size = chosen.stop - first
        behind = first + end * size // found.t.size
        if later == 0 and (chosen.floor is not None or size - (behind - first) < SHORTER * size):
            break
        if behind - first < SPARSE or later > 0:
            behind = chosen.stop
        first += later * size // found.t.size
        chosen = replace(chosen, stop=behind)
        found, reference = _blocks(record, chosen, first)
        noises, inverse, later, end = _noises(found)
    if chosen.stop < stop:
        last = f"{record.t[chosen.stop - 1]:.4g} s"
        ends = f"ends at {last}, {ABOVE_FLOOR:g} dB above the noise floor that its scatter shows"
        chosen = replace(chosen, why=(chosen.why[0], ends))
    return _result(record, chosen, first, found, reference, noises, inverse, seed)


def _blocks(record: EnvelopeRecord, window: Window, first: int) -> tuple[Blocks, float]:
    """The decay in blocks, and ln of its reference amplitude (the middle of the fall in dB, as a level's ln)."""
    t, x, _ = blocks(record.t[first : window.stop], record.level[first : window.stop] / NEPER, MOST)
    edge = max(1, t.size // 30)
    top, bottom = x[:edge].mean(), x[-edge:].mean()
    reference = 0.5 * float(top + bottom)
    duration = float(t[-1] - t[0])
    floor = None if window.floor is None else window.floor.scaled(np.exp(-2.0 * reference))
    mean_rate = float(top - bottom) / (duration * (1.0 - edge / t.size))
    each = (window.stop - first) / t.size
    return Blocks(t - t[0], x - reference, duration, mean_rate, floor, each), reference


def _noises(b: Blocks) -> tuple[list[tuple[Noise, np.ndarray]], np.ndarray, int, int]:
    """The noise inferred without and with a deviation, the inverse triangle in which fits are sought, how many blocks
    at the start are none of the decay, and how many stand before it comes too close to the floor."""
    n = b.t.size
    seen = np.sqrt(b.floor.power) if b.floor is not None else 1e-3
    terms = SUMS[-1]
    x0, rates = fit_rates(b, terms, np.diag(1.0 / np.maximum(0.02, np.exp(-b.x) * seen)))
    fit = decay(b.t, x0, terms, rates)
    h0, h = derivatives(b, terms, x0, rates)
    warp = warp_columns(b, rate(fit, terms, rates))
    columns = np.column_stack([h0, h])
    early = max(1, round(CHECKED * n)) if n >= 30 else 0
    rest = slice(early, n)
    given = (b.t[rest], (b.x - fit)[rest], fit[rest], columns[rest], warp[rest], b.floor)
    slow_time = 1.0 / b.mean_rate
    middle = infer_noise(*given, 0.5, slow_time, b.each)
    rivals = [
        infer_noise(*given, share, slow_time, b.each, begin=middle, only_floor=True) for share in SHARES
    ]
    best = max(rivals, key=lambda one: one.log_density)
    loose = infer_noise(*given, best.slow, slow_time, b.each, with_deviation=True, begin=best)
    rivals += [loose, best.slower(b.duration)]
    covariances = [(one, one.covariance(b.t, fit)) for one in rivals]
    whole = best.covariance(b.t, fit) + loose.deviation**2 * warp @ knot_covariance(KNOTS, SLOW) @ warp.T
    if best.constant > 0:
        one = 0.5 * best.constant * np.exp(-2.0 * fit)
        whole = whole + np.outer(one, one)
    inverse = np.linalg.inv(np.linalg.cholesky(whole))
    low = np.flatnonzero(np.exp(2.0 * fit) < 10.0 ** (ABOVE_FLOOR / 10.0) * best.floor)
    end = int(low[0]) if low.size else n
    return covariances, inverse, _strangers(whole, columns, b.x - fit, early), end


def _strangers(covariance: np.ndarray, columns: np.ndarray, residual: np.ndarray, early: int) -> int:
    """How many of the early blocks to leave out: up to the last that those after it do not foretell."""
    if early == 0:
        return 0
    # Backwards in time, each reading less what all later ones foretell of it, in its own sd; the law is left free.
    scale = columns / np.linalg.norm(columns, axis=0)
    whole = covariance + 1e2 * scale @ scale.T
    triangle = np.linalg.cholesky(whole[::-1, ::-1])
    innovations = np.linalg.solve(triangle, residual[::-1])[::-1][:early]
    off = np.zeros(early, bool)
    total = np.concatenate(
        [np.cumsum(innovations[::-1])[::-1], [0.0]]
    )  # from each block to the last early one
    for count in (1, 2, 4, 8):
        if count <= early:
            off[: early - count + 1] |= np.abs(
                total[: early - count + 1] - total[count:]
            ) > SURPRISE * np.sqrt(count)
    off = np.flatnonzero(off)
    return int(off[-1]) + 1 if off.size else 0


def _result(
    record: EnvelopeRecord,
    window: Window,
    first: int,
    b: Blocks,
    reference: float,
    noises: list[tuple[Noise, np.ndarray]],
    inverse: np.ndarray,
    seed: int,
) -> EnvelopeResult:
    candidates = _weighed(b, noises, inverse)
    log_prior = np.log(np.array([0.5 if len(c.terms) > 2 else 1.0 for c in candidates]))
    log_z = np.array([c.total for c in candidates]) + log_prior
    probability = np.exp(log_z - log_z.max())
    probability /= probability.sum()
    names = ["+".join(c.terms) for c in candidates]
    best = int(np.argmax(probability))
    exact_z = np.array([c.total_exact for c in candidates]) + log_prior
    decided = bool(probability[best] > DECIDED and np.argmax(exact_z) == best)
    probability_exact = float(np.exp(np.logaddexp.reduce(exact_z) - np.logaddexp.reduce(log_z)))
    edge = max(1, b.x.size // 30)
    top, bottom = float(b.x[:edge].mean()), float(b.x[-edge:].mean())
    amplitudes = np.array([top + share * (bottom - top) for share in ASKED])
    rng = np.random.default_rng([seed, b.t.size])
    draws = draw(b, candidates, log_prior, amplitudes, rng, _sensor(record, 0.5 * (top - bottom) * NEPER))
    plain = draw(b, candidates, log_prior, amplitudes, rng, sensor=0.0, exact=True)
    omega = 2.0 * np.pi * record.frequency if record.frequency else None

    whole = _estimated(draws.whole, plain.whole)
    at = tuple(
        _at(record, (amplitudes[i] + reference) * NEPER, draws.at[:, i], plain.at[:, i], omega)
        for i in range(amplitudes.size)
    )
    power_z, power_mean, power_variance = weigh_power(b, noises, inverse)
    exponent = _mixture_range(power_z, power_mean, power_variance, 0.0, 3.0)
    odds = float(np.logaddexp.reduce(power_z) - np.logaddexp.reduce(log_z) + np.log(np.exp(log_prior).sum()))
    low, middle, high = np.quantile(draws.deviation, [0.025, 0.5, 0.975])
    deviation = Range(float(middle), float(low), float(high))
    fitted = candidates[best]
    misfit, scatter = _misfit(b, fitted, noises)
    grade = (
        "exact"
        if probability_exact >= 0.5
        else "approximate"
        if deviation.high <= APPROXIMATE
        else "deviates"
    )
    if odds > POWER_LAW and not decided and b.t.size >= FEW:
        grade = "deviates"
    start = first
    why = list(window.why)
    if first > window.start:
        why[0] = (
            f"starts at {record.t[first]:.4g} s, where the reading before it is no continuation of the decay"
        )
    floor = 10.0 * np.log10(window.floor.power) if window.floor is not None else float("nan")
    cut = Cut(
        float(record.t[start]), float(record.t[window.stop - 1]), start, window.stop, tuple(why), float(floor)
    )
    energy = {
        term: Range(*(float(q) for q in np.quantile(draws.energy[:, i], [0.5, 0.025, 0.975])))
        for i, term in enumerate(POWERS)
    }
    curve = Curve(
        b.t + float(record.t[first : window.stop].min()) + 0.5 * (b.t[1] - b.t[0]) * (b.t.size == MOST),
        (b.x + reference) * NEPER,
        (fitted.fit + reference) * NEPER,
        np.sqrt(np.diag(noises[0][1])) * NEPER,
    )
    found = EnvelopeResult(
        name=record.name,
        grade=grade,
        sentence="",
        decided=decided and grade != "deviates",
        damping=names[best],
        probability=float(probability[best]),
        probabilities={n: float(p) for n, p in zip(names, probability, strict=True)},
        terms={
            t: float(sum(p for c, p in zip(candidates, probability, strict=True) if t in c.terms))
            for t in POWERS
        },
        frequency=record.frequency,
        rate=whole,
        quality_factor=_estimated(omega / 2 / draws.whole, omega / 2 / plain.whole) if omega else None,
        at=at,
        energy=energy,
        exponent=exponent,
        power_law=odds,
        deviation=deviation,
        probability_exact=probability_exact,
        unexplained_pct=100 * misfit,
        noise_pct=100 * scatter,
        coefficients=_coefficients(record, draws, plain, names[best], reference, omega, top),
        cut=cut,
        curve=curve,
    )
    said = remarks(found, record, window.stop - first, (top - bottom) * NEPER)
    return replace(found, sentence=sentence(found), remarks=said)


def _weighed(b: Blocks, noises: list[tuple[Noise, np.ndarray]], inverse: np.ndarray) -> list[Candidate]:
    """Every sum, with the first noise; with all of them those that it does not rule out."""
    found = [weigh(b, terms, noises[:1], inverse) for terms in SUMS]
    most = max(c.total for c in found)
    return [weigh(b, c.terms, noises, inverse, c) if c.total > most - HOPELESS else c for c in found]


def _sensor(record: EnvelopeRecord, fall: float) -> float:
    """Relative sd of any rate that the record does not tell. fall: dB of half of the decay."""
    return float(np.hypot(SENSOR, DRIFT / fall)) if record.logarithmic else SENSOR


def _estimated(draws: np.ndarray, plain: np.ndarray) -> Estimated:
    low, middle, high = (float(q) for q in np.nanquantile(draws, [0.025, 0.5, 0.975]))
    sd, noise = float(np.nanstd(draws)), float(np.nanstd(plain))
    noise = min(noise, sd)
    return Estimated(middle, low, high, noise, float(np.sqrt(max(sd * sd - noise * noise, 0.0))))


def _at(
    record: EnvelopeRecord, level: float, draws: np.ndarray, plain: np.ndarray, omega: float | None
) -> AtAmplitude:
    amplitude, unit = record.amplitude(level)
    ratio = _estimated(draws / omega, plain / omega) if omega else None
    quality = _estimated(omega / 2 / draws, omega / 2 / plain) if omega else None
    return AtAmplitude(float(amplitude), unit, _estimated(draws, plain), ratio, quality)


def _mixture_range(
    log_weight: np.ndarray, mean: np.ndarray, variance: np.ndarray, least: float, most: float
) -> Range:
    """Median and 95 % interval of a mixture of normals cut off at both ends."""
    weight = np.exp(log_weight - log_weight.max())
    grid = np.linspace(least, most, 3001)
    density = np.zeros_like(grid)
    for w, m, v in zip(weight, mean, variance, strict=True):
        if w > 1e-5:
            density += w / np.sqrt(v) * np.exp(-0.5 * (grid - m) ** 2 / v)
    total = np.cumsum(density)
    if not total[-1] > 0:  # narrower than the grid, or beyond an end of it
        centre = float(np.clip(weight @ mean / weight.sum(), least, most))
        return Range(centre, centre, centre)
    low, middle, high = (float(q) for q in np.interp([0.025, 0.5, 0.975], total / total[-1], grid))
    return Range(middle, low, high)


def _misfit(b: Blocks, c: Candidate, noises: list[tuple[Noise, np.ndarray]]) -> tuple[float, float]:
    """Root mean squares, relative to the amplitude and weighted by its square, of what the fit leaves and of noise."""
    weight = np.exp(2.0 * c.fit)
    weight = weight / weight.sum()
    off = b.x - c.fit
    off = off - weight @ off
    return float(np.sqrt(weight @ off**2)), float(np.sqrt(weight @ np.diag(noises[0][1])))


def _coefficients(
    record: EnvelopeRecord,
    draws: Draws,
    plain: Draws,
    damping: str,
    reference: float,
    omega: float | None,
    top: float,
) -> tuple[Coefficient, ...]:
    """Of the most probable sum's terms, over all sums that have them; relative to the amplitude at the start where the
    record has no scale."""
    relative = record.logarithmic
    amplitude = float(np.exp(-top)) if relative else float(np.exp(reference))
    found = []
    for i, term in enumerate(POWERS):
        if term not in damping.split("+"):
            continue
        have = np.isfinite(draws.terms[:, i])
        also = plain.terms[np.isfinite(plain.terms[:, i]), i]
        name, values, unit = coefficients([term], draws.terms[have, i][None], amplitude, omega)[0]
        same = coefficients([term], also[None], amplitude, omega)[0][1] if also.size else values
        shown = unit.format("A_start" if relative else _root(record.unit))
        found.append(Coefficient(name, shown, _estimated(values, same)))
    return tuple(found)


def _root(unit: str) -> str:
    """The amplitude's unit where its power's is given."""
    return f"√{unit}" if unit in ("W", "mW", "uW", "nW", "pW") else unit.replace("^2", "").replace("2", "")
