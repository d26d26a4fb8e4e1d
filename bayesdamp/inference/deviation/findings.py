"""What a weighing says: draws over candidates, hyperparameters and coefficients, and the numbers that follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.deviation.candidate import Candidate
from bayesdamp.inference.deviation.gaussian.orthant import draw
from bayesdamp.inference.deviation.orbit import Cycle, cycle_at, natural_frequency, rest_of
from bayesdamp.inference.deviation.weighing import Result, Weighing
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.restoring import LAWS

DRAWS = 4000
SENSOR = 0.002
"""Relative standard deviation below which no rate is known: the sensor's linearity and the clock's."""
EXOTIC = 0.1
"""Prior weight of a sum with another form of damping."""
THIRD = 0.5
"""Prior weight of a sum of three terms beside sums of one or two."""
NEGLIGIBLE = 1e-4
CURVE = 12
"""Amplitudes of a curve."""
SHOWN = 0.99
"""Probability of the candidates together from which the others are not drawn from."""


@dataclass(frozen=True)
class Quantity:
    """A number: median, 95 % interval, and the parts of its standard deviation from noise and from the law."""

    value: float
    low: float
    high: float
    sd_noise: float = float("nan")
    sd_law: float = float("nan")


@dataclass(frozen=True)
class Ratio:
    """Equivalent viscous damping ratio at an amplitude (rad or m)."""

    amplitude: float
    value: float
    low: float
    high: float
    sd_noise: float
    sd_law: float


@dataclass(frozen=True)
class Findings:
    """A weighing in numbers, before anything is decided.

    damping, exact: probability of each sum (its terms joined by +) under laws that hold approximately, and exactly.
    exotic: of sums with another form of damping. exponent: of a power law in the velocity. restoring: of each law.
    term: of each term, summed over the sums that have it. ratios: at the amplitudes asked for, curve: over all.
    energy: share of the dissipated energy by term; bound: 95 % upper limit of an absent one's beside the likeliest sum.
    deviation, restoring_deviation: energy-weighted mean of the relative deviation of the damping and restoring laws.
    other: 95 % upper limit of the share of any other form. coefficients: under the likeliest sum. unexplained, noise:
    root mean square of what the likeliest candidate leaves beyond noise, and of the noise, as shares of the amplitude.
    """

    damping: Mapping[str, float]
    exact: Mapping[str, float]
    exotic: Mapping[str, float]
    exponent: Quantity | None
    restoring: Mapping[str, float]
    term: Mapping[str, float]
    ratios: tuple[Ratio, ...]
    curve: tuple[Ratio, ...]
    frequency: Quantity
    energy: Mapping[str, Quantity]
    bound: Mapping[str, float]
    deviation: Quantity
    restoring_deviation: Quantity
    other: float
    coefficients: Mapping[str, Quantity]
    best: Candidate
    unexplained: float
    noise: float
    amplitudes: tuple[float, float]
    cycles: float


@dataclass(frozen=True)
class _Drawn:
    """Draws of one candidate: coefficients (n, m), log g and h at the knots (n, k), law's parameters (n, r)."""

    result: Result
    coefficients: np.ndarray
    g: np.ndarray
    h: np.ndarray
    law: np.ndarray


def probabilities(weighing: Weighing, exact: bool) -> dict[Candidate, float]:
    """Posterior probability of each candidate. Prior: the sums alike, of three half; laws alike."""
    logs: dict[Candidate, float] = {}
    for r in (*weighing.results, *weighing.forms):
        weighed = r.exact_weighed if exact else r.weighed
        if weighed is None:
            continue
        odds = THIRD if len(r.candidate.damping) > 2 else 1.0
        odds *= EXOTIC if r in weighing.forms else 1.0
        logs[r.candidate] = weighed.log_evidence + np.log(odds)
    if not logs:  # none could be linearised: exact laws are all that is known
        return probabilities(weighing, True)
    top = max(logs.values())
    total = sum(np.exp(v - top) for v in logs.values())
    return {c: float(np.exp(v - top) / total) for c, v in logs.items()}


def summed(found: Mapping[Candidate, float], key: str) -> dict[str, float]:
    """Probabilities by damping sum ("damping") or by law ("restoring"), the largest first."""
    totals: dict[str, float] = {}
    for c, p in found.items():
        name = "+".join(c.damping) if key == "damping" else c.restoring
        totals[name] = totals.get(name, 0.0) + p
    return dict(sorted(totals.items(), key=lambda item: -item[1]))


def default_amplitudes(weighing: Weighing) -> tuple[float, float, float]:
    """Near the first, the middle (in the logarithm) and near the last amplitude of the record."""
    data = weighing.data
    first, last = data.amplitude, max(data.final_amplitude, 1e-6 * data.amplitude)
    span = np.log(first / last)
    return tuple(float(first * np.exp(-span * share)) for share in (0.1, 0.5, 0.9))  # type: ignore[return-value]


def findings(
    weighing: Weighing,
    amplitudes: Sequence[float] | None = None,
    *,
    approximate: bool = True,
    sensor: float = SENSOR,
    seed: int = 0,
) -> Findings:
    """The numbers of a weighing. amplitudes: where the damping ratio is asked for; three of the record by default.

    approximate: under laws that hold approximately, with the sensor's floor; else exactly, without.
    """
    rng = np.random.default_rng(seed)
    exact_all = probabilities(weighing, True)
    everything = probabilities(weighing, False) if approximate else exact_all
    own = {r.candidate for r in weighing.results}
    exotic = sum(p for c, p in everything.items() if c not in own)
    chosen = {c: p / max(1 - exotic, 1e-300) for c, p in everything.items() if c in own}
    wanted = tuple(amplitudes) if amplitudes is not None else default_amplitudes(weighing)
    drawn = _drawn(weighing, chosen, approximate, rng)
    best = max(chosen, key=lambda c: chosen[c])
    result = next(r for r in weighing.results if r.candidate == best)
    terms = next(iter(weighing.solvers.values())).terms
    shares = _shares(weighing, drawn)
    damping = summed(chosen, "damping")
    absent = _bounds(weighing, best, approximate, terms, rng)
    size = np.concatenate([_size(weighing, d, d.g) for d in drawn])
    size_h = np.concatenate([_size(weighing, d, d.h) for d in drawn])
    left = result.about.left if result.about is not None else result.fit.residual
    clean = float(left @ left) / max(left.size - (result.about.u.size if result.about else 0), 1)
    rest = max(float(result.fit.residual @ result.fit.residual) / left.size - clean, 0.0)
    return Findings(
        damping={n: p * (1 - exotic) for n, p in damping.items()},
        exotic=summed({c: p for c, p in everything.items() if c not in own}, "damping"),
        exponent=_exponent(weighing, approximate, rng),
        exact=summed({c: p for c, p in exact_all.items() if c in own}, "damping"),
        restoring=summed(chosen, "restoring"),
        term={t: sum(p for c, p in chosen.items() if t in c.damping) for t in terms},
        ratios=tuple(_ratio(weighing, drawn, a, sensor if approximate else 0.0, rng) for a in wanted),
        curve=tuple(_ratio(weighing, drawn, a, sensor if approximate else 0.0, rng) for a in _grid(weighing)),
        frequency=_frequency(weighing, drawn),
        energy={t: _quantity(shares[:, i]) for i, t in enumerate(terms)},
        bound=absent,
        deviation=_quantity(size),
        restoring_deviation=_quantity(size_h),
        other=float(np.quantile(size, 0.95)),
        coefficients=_coefficients(weighing, drawn, best),
        best=best,
        unexplained=float(np.sqrt(rest)) / weighing.data.recorded_amplitude,
        noise=float(np.sqrt(clean)) / weighing.data.recorded_amplitude,
        amplitudes=(weighing.data.amplitude, weighing.data.final_amplitude),
        cycles=weighing.data.cycles,
    )


def _grid(weighing: Weighing) -> tuple[float, ...]:
    """Amplitudes of a curve, from the record's first to its last."""
    data = weighing.data
    return tuple(map(float, np.geomspace(data.amplitude, data.final_amplitude, CURVE)))


def _quantity(values: np.ndarray, noise: float = float("nan")) -> Quantity:
    low, middle, high = (float(q) for q in np.quantile(values, (0.025, 0.5, 0.975)))
    law = float(np.sqrt(max(float(np.var(values)) - noise**2, 0.0))) if np.isfinite(noise) else float("nan")
    return Quantity(middle, low, high, noise, law)


def _drawn(
    weighing: Weighing, chosen: Mapping[Candidate, float], approximate: bool, rng: np.random.Generator
) -> list[_Drawn]:
    """Draws of the candidates that count, each as often as it is probable."""
    order = sorted(chosen.items(), key=lambda item: -item[1])
    kept, total = [], 0.0
    for c, p in order:
        kept.append((c, p))
        total += p
        if total > SHOWN:
            break
    found = []
    for c, p in kept:
        result = next(r for r in weighing.results if r.candidate == c)
        count = round(DRAWS * p / total)
        if count:
            found.append(_draws_of(weighing, result, count, approximate, rng))
    return found


def _draws_of(
    weighing: Weighing, result: Result, count: int, approximate: bool, rng: np.random.Generator
) -> _Drawn:
    weighed = result.weighed if approximate else result.exact_weighed
    assert weighed is not None
    d, parameters = result.fit.z.size, result.fit.parameters
    knots = weighing.solvers[result.candidate.restoring].knots.size
    weights = np.where(weighed.weights > NEGLIGIBLE, weighed.weights, 0.0)
    numbers = rng.multinomial(count, weights / weights.sum())
    places = np.flatnonzero(parameters.positive)
    parts = [
        draw(rng, weighed.means[i], weighed.factors[i], places, int(numbers[i]))
        for i in np.flatnonzero(numbers)
    ]
    u = np.concatenate(parts)
    z, rest = u[:, :d], u[:, d:]
    if not approximate:
        rest = np.zeros((count, 2 * knots))
    m = len(weighing.solvers[result.candidate.restoring].terms)
    r = len(LAWS.get(result.candidate.restoring).parameters)
    values = np.array([parameters.values(row) for row in z])
    return _Drawn(result, values[:, :m], rest[:, :knots], rest[:, knots:], values[:, m : m + r])


def _times(result: Result) -> tuple[np.ndarray, np.ndarray]:
    """Times in s of a motion's half cycles, and half the distance of their turning points, in falling order."""
    motion = result.motion
    v = motion.states[:, 1]
    turns = np.flatnonzero(v[:-1] * v[1:] <= 0)
    share = v[turns] / np.where(v[turns] == v[turns + 1], 1.0, v[turns] - v[turns + 1])
    t = motion.times[turns] + share * (motion.times[turns + 1] - motion.times[turns])
    h = motion.times[turns + 1] - motion.times[turns]
    x = motion.states[turns, 0] + h * share * (
        motion.states[turns, 1] + 0.5 * h * share * motion.states[turns, 2]
    )
    sizes, at = 0.5 * np.abs(np.diff(x)), 0.5 * (t[1:] + t[:-1])
    good = sizes > 0
    return at[good], np.minimum.accumulate(sizes[good])


def _share_of_time(weighing: Weighing, result: Result, amplitude: float) -> float:
    """When the motion has this amplitude, as a share of the record."""
    at, sizes = _times(result)
    if at.size < 2:
        return 0.5
    t = np.interp(-np.log(amplitude), -np.log(sizes), at)
    return float(np.clip(t / weighing.data.t[-1], 0.0, 1.0))


def cycle_of(
    weighing: Weighing, result: Result, amplitude: float, epsilon: float | None = None
) -> Cycle | None:
    """The cycle of an amplitude under a result's own law; epsilon: in place of its own."""
    c, solver = result.candidate, weighing.solvers[result.candidate.restoring]
    z = result.about.u[: result.fit.z.size] if result.about is not None else result.fit.z
    p = result.fit.parameters.values(z)
    m, r = len(solver.terms), len(LAWS.get(c.restoring).parameters)
    law = p[m : m + r]
    rest = rest_of(c.restoring, law, weighing.data.rest, 2 * weighing.data.amplitude)
    if rest is None:
        return None
    return cycle_at(
        amplitude, solver.terms, solver.epsilon if epsilon is None else epsilon, c.restoring, law, rest
    )


def _at(values: np.ndarray, share: float) -> np.ndarray:
    """Values at equidistant knots, (n, k), at a share of the record: (n,)."""
    k = values.shape[1]
    at = share * (k - 1)
    i = min(int(at), k - 2)
    return (1 - at + i) * values[:, i] + (at - i) * values[:, i + 1]


def _ratio(
    weighing: Weighing, drawn: Sequence[_Drawn], amplitude: float, sensor: float, rng: np.random.Generator
) -> Ratio:
    values, noises, weights = [], [], []
    for d in drawn:
        cycle = cycle_of(weighing, d.result, amplitude)
        if cycle is None:
            continue
        share = _share_of_time(weighing, d.result, amplitude)
        each = _under_frictions(weighing, d, amplitude, cycle, rng)
        values.append(each * np.exp(_at(d.g, share)) / (1 + _at(d.h, share)))
        noises.append(_noise_sd(weighing, d.result, cycle))
        weights.append(len(d.coefficients))
    if not values:
        return Ratio(amplitude, *(float("nan"),) * 5)
    found = np.concatenate(values)
    found = found * (1 + sensor * rng.standard_normal(found.size))
    noise = float(np.average(noises, weights=weights))
    q = _quantity(found, min(noise, float(np.std(found))))
    return Ratio(amplitude, q.value, q.low, q.high, q.sd_noise, q.sd_law)


def _under_frictions(
    weighing: Weighing, d: _Drawn, amplitude: float, cycle: Cycle, rng: np.random.Generator
) -> np.ndarray:
    """Ratios of the draws, (n,), each under one of the widths of friction by their probability."""
    found = d.coefficients @ cycle.ratios
    active = d.result.fit.active
    solver = weighing.solvers[d.result.candidate.restoring]
    switching = any(TERMS.get(t).switches and on for t, on in zip(solver.terms, active, strict=True))
    if not switching or not weighing.frictions:
        return found
    used = min(weighing.frictions, key=lambda f: abs(f.epsilon - solver.epsilon))
    chosen = rng.choice(len(weighing.frictions), len(found), p=[f.weight for f in weighing.frictions])
    for i, friction in enumerate(weighing.frictions):
        rows = chosen == i
        other = cycle_of(weighing, d.result, amplitude, friction.epsilon) if rows.any() else None
        if other is None:
            continue
        scale = np.where(
            used.coefficients > 0,
            friction.coefficients / np.where(used.coefficients > 0, used.coefficients, 1),
            1,
        )
        scale = np.clip(scale, 0.5, 2.0)
        found[rows] = d.coefficients[rows] * scale @ other.ratios
    return found


def _noise_sd(weighing: Weighing, result: Result, cycle: Cycle) -> float:
    """The ratio's standard deviation from noise alone, under exact laws."""
    factor = result.exact_weighed.factors[0]
    parameters, m = result.fit.parameters, cycle.ratios.size
    slopes = parameters.slopes(result.fit.z)
    gradient = np.zeros(parameters.free.size)
    for i, place in enumerate(parameters.free):
        if place < m:
            gradient[i] = cycle.ratios[place] * slopes[i]
    scale = np.sqrt(weighing.variance / result.exact_variance)
    return float(np.linalg.norm(gradient @ factor)) * float(scale)


def _frequency(weighing: Weighing, drawn: Sequence[_Drawn]) -> Quantity:
    values = []
    for d in drawn:
        name = d.result.candidate.restoring
        z = d.result.fit.z
        m = len(weighing.solvers[name].terms)
        centre = d.result.fit.parameters.values(z)[m : m + d.law.shape[1]]
        rest = rest_of(name, centre, weighing.data.rest, 2 * weighing.data.amplitude)
        # Draws come by their hyperparameters: some of each.
        every = slice(None, None, max(1, len(d.law) // 200))
        for row, h in zip(d.law[every], d.h.mean(axis=1)[every], strict=True):
            at = weighing.data.rest if rest is None else rest
            values.append(natural_frequency(name, row, at, weighing.data.amplitude) * (1 + h) / (2 * np.pi))
    return _quantity(np.array(values))


def _work(weighing: Weighing, result: Result) -> np.ndarray:
    """Work of each term per unit of its coefficient over the record's own motion, (m,)."""
    solver = weighing.solvers[result.candidate.restoring]
    at, times, states = _even(result)
    x, v = np.interp(at, times, states[:, 0]), np.interp(at, times, states[:, 1])
    works = (
        [
            abs(TERMS.get(n).kernel(float(a), float(s), solver.epsilon) * float(s))
            for a, s in zip(x, v, strict=True)
        ]
        for n in solver.terms
    )
    return np.array([np.mean(work) for work in works])


def _even(result: Result) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Even times over a motion, its nodes' times and states."""
    motion = result.motion
    return np.linspace(motion.times[0], motion.times[-1], 4000), motion.times, motion.states


def _shares(weighing: Weighing, drawn: Sequence[_Drawn]) -> np.ndarray:
    """Share of the dissipated energy by term, (draws, m)."""
    found = []
    for d in drawn:
        each = d.coefficients * _work(weighing, d.result)
        found.append(each / np.maximum(each.sum(axis=1, keepdims=True), 1e-300))
    return np.concatenate(found)


def _bounds(
    weighing: Weighing, best: Candidate, approximate: bool, terms: tuple[str, ...], rng: np.random.Generator
) -> dict[str, float]:
    """95 % upper limits of the share of each term that the likeliest sum lacks, were it there beside that sum."""
    found = {}
    for term in terms:
        wanted = {*best.damping, term}
        beside = (
            r
            for r in weighing.results
            if set(r.candidate.damping) == wanted and r.candidate.restoring == best.restoring
        )
        result = next(beside, None)
        if term in best.damping or result is None or (approximate and result.weighed is None):
            continue
        shares = _shares(weighing, [_draws_of(weighing, result, DRAWS // 4, approximate, rng)])
        found[term] = float(np.quantile(shares[:, terms.index(term)], 0.95))
    return found


def _exponent(weighing: Weighing, approximate: bool, rng: np.random.Generator) -> Quantity | None:
    """The exponent of the power law, with its interval; None where it has no fit."""
    result = weighing.power
    weighed = None if result is None else result.weighed if approximate else result.exact_weighed
    if result is None or weighed is None:
        return None
    parameters = result.fit.parameters
    place = parameters.free_names.index("exponent")
    weights = np.where(weighed.weights > NEGLIGIBLE, weighed.weights, 0.0)
    numbers = rng.multinomial(DRAWS, weights / weights.sum())
    positive = np.flatnonzero(parameters.positive)
    parts = [
        draw(rng, weighed.means[i], weighed.factors[i], positive, int(numbers[i]))[:, place]
        for i in np.flatnonzero(numbers)
    ]
    return _quantity(parameters.priors["exponent"].value(np.concatenate(parts)))


def _size(weighing: Weighing, d: _Drawn, values: np.ndarray) -> np.ndarray:
    """Energy-weighted mean of |deviation| over the record, about its own mean there, (n,)."""
    at, sizes = _times(d.result)
    share = np.linspace(0, 1, values.shape[1])
    few = at.size < 2
    weight = np.ones(share.size) if few else np.interp(share * weighing.data.t[-1], at, sizes) ** 2
    weight = weight / weight.sum()
    centred = values - (values @ weight)[:, None]
    return np.abs(centred) @ weight


def _coefficients(weighing: Weighing, drawn: Sequence[_Drawn], best: Candidate) -> dict[str, Quantity]:
    names = weighing.solvers[best.restoring].names
    d = next((d for d in drawn if d.result.candidate == best), None)
    if d is None:
        return {}
    factor = d.result.exact_weighed.factors[0]
    parameters = d.result.fit.parameters
    sds = np.linalg.norm(factor, axis=1) * np.abs(parameters.slopes(d.result.fit.z))
    sds *= np.sqrt(weighing.variance / d.result.exact_variance)
    by_name = dict(zip(parameters.free_names, map(float, sds), strict=True))
    values = np.column_stack([d.coefficients, d.law])
    return {
        name: _quantity(values[:, i], by_name[name])
        for i, name in enumerate(names[: values.shape[1]])
        if name in by_name
    }
