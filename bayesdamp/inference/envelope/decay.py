"""The free decay of an envelope: its window, its readings in blocks, and the noise of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from bayesdamp.inference.deviation.linear import smooth_root
from bayesdamp.inference.envelope.candidates import KNOTS, Blocks, fit_rates, solver_of
from bayesdamp.inference.envelope.noise import SHARES, SLOW, infer_noise
from bayesdamp.inference.envelope.sums import Sum, loosest_fit, sums_on
from bayesdamp.physics.amplitude import EXPONENTS, SUMS, ClosedForm, Scale, power_decay, power_slopes
from bayesdamp.physics.kernel.solve import ALL
from bayesdamp.records.envelope.record import EnvelopeRecord, scale_of
from bayesdamp.records.envelope.window import (
    ABOVE_FLOOR,
    LEAST_DROP,
    NEPER,
    EnvelopeWindow,
    average_in_blocks,
    find_window,
)
from bayesdamp.types import Refusal

MOST = 100
"""Largest number of means of readings that are weighed: enough for a decay of 40 dB and its noise."""
TRIES = 3
SHORTER = 0.05
"""A decay without a visible floor is cut where its scatter shows one, if that shortens it by this share at least."""
SPARSE = 40
"""With fewer readings, none is left out as an outlier."""
FEWEST = 30
"""Blocks needed to look for a held level."""
FIRST, EACH = 2, 3
"""Ends of a held level that are tried: from block FIRST to half of all, every EACH blocks."""
BETTER = 0.75
"""Largest misfit with a held level, as a share of the misfit of a decay from the start on."""
LEAST = 0.02
"""Smallest scatter of ln A: laws and detectors are a percentage off."""
CHECKED = 0.1
"""Share of the decay at its start that is compared with the rest."""
SURPRISE = 4.5
"""Standard deviations at which it does not belong to the decay (one in 30,000 of 5 normal ones does)."""


@dataclass(frozen=True, eq=False)
class Curve:
    """A decay for pictures, in arrays of shape (n,).

    Attributes
    ----------
    t
        Times in s on the record's clock.
    level, fit
        Levels in dB of the recorded power: of the readings' means, and of the best sum with its law's deviation.
    fit_sd, scatter
        Standard deviations of the fit and of a reading, in dB.
    """

    t: np.ndarray
    level: np.ndarray
    fit: np.ndarray
    fit_sd: np.ndarray
    scatter: np.ndarray


@dataclass(frozen=True, eq=False)
class Decay:
    """The free decay of a record with the noise of its readings.

    Attributes
    ----------
    record
        The record.
    window
        The free decay.
    blocks
        Its readings with their noises.
    reference
        ln of their reference amplitude in the record's unit.
    """

    record: EnvelopeRecord
    window: EnvelopeWindow
    blocks: Blocks
    reference: float

    @property
    def readings(self) -> int:
        """Number of readings in the decay."""
        return self.window.stop - self.window.start

    @property
    def fall(self) -> float:
        """Fall of the level in dB."""
        top, bottom = self.blocks.ends
        return (top - bottom) * NEPER

    def amplitude(self, x: float) -> tuple[float, str]:
        """Return the amplitude at ln(A/A_ref) as the record states amplitudes, and its unit."""
        value, unit = self.record.amplitude((x + self.reference) * NEPER)
        return float(value), unit

    def curve(self, fit: np.ndarray, sd: np.ndarray) -> Curve:
        """Return the readings with ln(A/A_ref) of a sum and its sd, (n,) both."""
        b, t = self.blocks, self.record.t[self.window.start : self.window.stop]
        # The blocks' own clock starts at the middle of the first one.
        start = float(t.min()) + 0.5 * (b.t[1] - b.t[0]) * (b.each > 1)
        level, fitted = ((x + self.reference) * NEPER for x in (b.x, fit))
        return Curve(b.t + start, level, fitted, sd * NEPER, np.sqrt(np.diag(b.noises[0][1])) * NEPER)

    def misfit(self, fit: np.ndarray) -> tuple[float, float]:
        """Return the root mean squares of the residuals of a fit beyond the noise, and of the noise.

        Both are relative to the amplitude and weighted by its square.
        """
        weight = np.exp(2.0 * fit)
        weight = weight / weight.sum()
        off = self.blocks.x - fit
        off = off - weight @ off
        left, noise = float(weight @ off**2), float(weight @ np.diag(self.blocks.noises[0][1]))
        return float(np.sqrt(max(left - noise, 0.0))), float(np.sqrt(noise))


def free_decay(
    record: EnvelopeRecord, window: EnvelopeWindow | None, sums: Sequence[tuple[str, ...]]
) -> tuple[Decay, tuple[Sum, ...]]:
    """Find the free decay of a record, down to the floor that its noise shows, and the sums on it.

    Parameters
    ----------
    record : EnvelopeRecord
        The record.
    window : Window or None
        The window to use, None to find one.
    sums : sequence of tuple of str
        Terms of each damping sum.

    Raises
    ------
    Refusal
        Where the level does not fall.
    """
    chosen = window or find_window(record.t, record.level)
    first, stop, why = chosen.start, chosen.stop, list(chosen.why)
    for _ in range(TRIES):
        b, _ = _blocks(record, chosen)
        size = chosen.stop - chosen.start
        held_level = held_blocks(b) if window is None and size >= SPARSE else 0
        if held_level == 0:
            break
        chosen = replace(chosen, start=chosen.start + held_level * size // b.t.size)
    tries = 0
    while True:
        b, reference = _blocks(record, chosen)
        # The parameters of terms are relative to the start of the decay.
        start, plain = b.ends[0], tuple(sums) == SUMS
        scale = Scale() if plain else scale_of(record, sums, start + reference)
        asked = sums_on(sums, scale, start, float(b.x.min()))
        b, later, end = infer_noises(b, asked)
        size = chosen.stop - chosen.start
        if window is not None or size < SPARSE or tries == TRIES:
            break
        within = end * size // b.t.size
        if later == 0 and (chosen.floor is not None or size - within < SHORTER * size):
            break
        behind = chosen.stop if within < SPARSE or later > 0 else chosen.start + within
        chosen = replace(chosen, start=chosen.start + later * size // b.t.size, stop=behind)
        tries += 1
    if chosen.start > first:
        begins = f"{record.t[chosen.start]:.4g} s"
        why[0] = f"starts at {begins}, where the reading before it does not continue the decay"
    if chosen.stop < stop:
        last = f"{record.t[chosen.stop - 1]:.4g} s"
        why[1] = f"ends at {last}, {ABOVE_FLOOR:g} dB above the noise floor that its scatter shows"
    return Decay(record, replace(chosen, why=tuple(why)), b, reference), asked


def _blocks(record: EnvelopeRecord, window: EnvelopeWindow) -> tuple[Blocks, float]:
    """Return the decay in blocks, and ln of its reference amplitude: the middle of the fall in dB.

    Raises Refusal where the fall is too small to determine its rate.
    """
    whole = slice(window.start, window.stop)
    t, x, _ = average_in_blocks(record.t[whole], record.level[whole] / NEPER, MOST)
    edge = max(1, t.size // 30)
    top, bottom = x[:edge].mean(), x[-edge:].mean()
    drop = NEPER * float(top - bottom)
    if not drop >= LEAST_DROP:
        raise Refusal(
            f"between {record.t[window.start]:.4g} and {record.t[window.stop - 1]:.4g} s the level falls by "
            f"{max(drop, 0.0):.1f} dB, {LEAST_DROP:g} are needed"
        )
    reference = 0.5 * float(top + bottom)
    duration = float(t[-1] - t[0])
    floor = None if window.floor is None else window.floor.scaled(np.exp(-2.0 * reference))
    mean_rate = float(top - bottom) / (duration * (1.0 - edge / t.size))
    each = (window.stop - window.start) / t.size
    frequency = 2.0 * np.pi * record.frequency if record.frequency else None
    return Blocks(t - t[0], x - reference, duration, mean_rate, floor, each, frequency), reference


def held_blocks(b: Blocks) -> int:
    """Return how many blocks at the start are those of a drive, where the level is held.

    From then on the level decays by the sum of all three dampings. This has to fit much better than these, or rising
    friction, do from the start on; otherwise the answer is 0.
    """
    n = b.t.size
    if n < FEWEST:
        return 0
    visible = np.sqrt(b.floor.power) if b.floor is not None else 0.0
    inverse = np.diag(1.0 / np.maximum(LEAST, np.exp(-b.x) * visible))
    law, rates = ClosedForm(SUMS[-1]), None

    def misfit(held_level: int) -> float:
        nonlocal rates
        fit = fit_rates(replace(b, t=np.maximum(b.t - b.t[held_level], 0.0)), law, inverse, rates)
        rates = np.maximum(fit.values[:-1], 1e-3 * b.mean_rate)  # the next fit is near
        return fit.squares

    tried = range(FIRST, n // 2, EACH)
    left = [misfit(end) for end in tried]
    best = int(np.argmin(left))
    better = left[best] < BETTER * misfit(0) and left[best] < BETTER * _by_rising_friction(b, inverse)
    return tried[best] + 1 if better else 0


def _by_rising_friction(b: Blocks, inverse: np.ndarray) -> float:
    """Return the misfit of a decay from the start on by one negative power of the amplitude.

    Friction that rises towards rest keeps the amplitude for long and then reduces it fast, as a held level does, and no
    sum of the three dampings describes it.
    """

    def off(p: np.ndarray) -> np.ndarray:
        return inverse @ (b.x - power_decay(b.t, p[0], p[1] - (p[2] - 1.0) * p[0], p[2]))

    def slopes(p: np.ndarray) -> np.ndarray:
        return -inverse @ power_slopes(b.t, p)

    steepest, top = EXPONENTS[0], b.ends[0]
    q = 0.5 * steepest - 1.0
    rate = np.expm1(q * (top - b.ends[1])) / (q * b.duration)  # the same fall in the same time
    begin = np.array([top, np.log(rate), q + 1.0])
    bounds = np.array([-np.inf, -np.inf, steepest]), np.array([np.inf, np.inf, 0.0])
    fit = least_squares(off, begin, slopes, bounds=bounds, x_scale=[1.0, 1.0, 0.3], max_nfev=60)  # type: ignore[arg-type]
    return 2.0 * float(fit.cost)


def infer_noises(b: Blocks, sums: Sequence[Sum] = ()) -> tuple[Blocks, int, int]:
    """Infer the noise of a decay's readings, whatever its law, and the readings that do not belong to it.

    Parameters
    ----------
    b : Blocks
        The readings.
    sums : sequence of Sum
        Sums that may describe the decay, besides that of viscous, Coulomb and quadratic damping.

    Returns
    -------
    blocks : Blocks
        The readings with means corrected to the decay at the blocks' times, and with the noises that are inferred
        without and with a deviation.
    later, end : int
        Number of blocks at the start that do not belong to the decay, and of blocks before it comes too close to the
        floor.
    """
    n = b.t.size
    visible = np.sqrt(b.floor.power) if b.floor is not None else 1e-3
    rough = np.diag(1.0 / np.maximum(0.02, np.exp(-b.x) * visible))
    law, x0, rates = loosest_fit(b, sums, rough)
    fit = law.decay(b.t, x0, rates)
    # The mean of a decay's readings in each block minus the decay at their mean time, to second order.
    off = np.gradient(b.t) * np.sqrt(max(1.0 - b.each**-2, 0.0) / 12.0)
    before = law.decay(b.t - off, x0, rates)
    bend = 0.5 * (before + law.decay(b.t + off, x0, rates)) - fit
    b = replace(b, x=b.x - bend)
    tangents = solver_of(b, law).solve(np.append(rates, x0), tangents=ALL).tangents
    columns, warp = tangents[:, :-KNOTS], tangents[:, -KNOTS:]
    early = max(1, round(CHECKED * n)) if n >= 30 else 0
    rest = slice(early, n)
    given = (b.t[rest], (b.x - fit)[rest], fit[rest], columns[rest], warp[rest], b.floor)
    slow_time = 1.0 / b.mean_rate
    middle = infer_noise(*given, 0.5, slow_time, b.each)
    rivals = [
        infer_noise(*given, share, slow_time, b.each, begin=middle, only_floor=True) for share in SHARES
    ]
    best = max(rivals, key=lambda noise: noise.log_density)
    loose = infer_noise(*given, best.slow, slow_time, b.each, with_deviation=True, begin=best)
    rivals += [loose, best.slower(b.duration)]
    noises = tuple((noise, noise.covariance(b.t, fit)) for noise in rivals)
    smooth = loose.deviation * warp @ smooth_root(KNOTS, SLOW)
    whole = best.covariance(b.t, fit) + smooth @ smooth.T
    if best.constant > 0:
        floor = 0.5 * best.constant * np.exp(-2.0 * fit)
        whole = whole + np.outer(floor, floor)
    low = np.flatnonzero(np.exp(2.0 * fit) < 10.0 ** (ABOVE_FLOOR / 10.0) * best.floor)
    end = int(low[0]) if low.size else n
    later = 0  # up to the last early block that the later ones do not predict
    if early:
        # Backwards in time, each reading minus its prediction from all later ones, in its own sd; the law is left free.
        scale = columns / np.linalg.norm(columns, axis=0)
        triangle = np.linalg.cholesky((whole + 1e2 * scale @ scale.T)[::-1, ::-1])
        innovations = np.linalg.solve(triangle, (b.x - fit)[::-1])[::-1][:early]
        total = np.append(np.cumsum(innovations[::-1])[::-1], 0.0)  # from each block to the last early one
        surprises = np.zeros(early, bool)
        for count in (1, 2, 4, 8):
            if count <= early:
                places = early - count + 1
                moved = np.abs(total[:places] - total[count:])
                surprises[:places] |= moved > SURPRISE * np.sqrt(count)
        later = int(np.flatnonzero(surprises).max(initial=-1)) + 1
    return replace(b, noises=noises, inverse=np.linalg.inv(np.linalg.cholesky(whole))), later, end
