"""Find the free decay of an envelope, average its readings in blocks, and infer the noise of the blocks."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.inference.deviation.linear import smooth_root
from bayesdamp.inference.envelope.candidates import KNOTS, Blocks, fit_power, fit_rates, solver_of
from bayesdamp.inference.envelope.noise import DEVIATION_LENGTH, SLOW_FRACTIONS, infer_noise
from bayesdamp.inference.envelope.sums import Sum, is_other_form, loosest_fit
from bayesdamp.physics.amplitude import FORMS, LOG_AT_REST, SUMS, Scale
from bayesdamp.physics.kernel.solve import ALL
from bayesdamp.records.envelope.record import EnvelopeRecord, scale_of
from bayesdamp.records.envelope.window import (
    ABOVE_FLOOR,
    LEAST_DROP,
    NEPER,
    SPARSE_READINGS,
    EnvelopeWindow,
    average_in_blocks,
    find_window,
)
from bayesdamp.types import Refusal

MOST_BLOCKS = 100
"""Greatest number of blocks in which the readings of a decay are averaged; enough for a decay of 40 dB and its
noise."""
MOST_WINDOW_CHANGES = 3
"""Greatest number of times that the window of a decay is changed for each of two reasons: first because of a constant
level at the start, then because of readings that do not belong to the decay or are close to the noise floor."""
LEAST_SHORTENING = 0.05
"""If no noise floor was measured after the decay, it is inferred from the scatter of the readings. The decay is then
shortened to end above the floor, but only if at least this fraction of its readings is left out."""
FEW_READINGS = 40
"""A window of the decay with fewer readings than this is only changed because of a constant level at the start, not
because of readings that do not belong to the decay or are close to the noise floor. A longer window is not shortened to
fewer readings than this."""
LEAST_BLOCKS_HELD = 12
"""A constant level at the start of a record, where the oscillation is still driven, is searched for only if the record
has at least this many blocks of readings."""
FIRST_END, END_STEP = 2, 3
"""Indices of the blocks of readings that are tried as the end of a constant level at the start of a record: from
`FIRST_END` to the middle of the record, in steps of `END_STEP`. In a record of fewer than `SPARSE_READINGS` blocks the
step is 1."""
HELD_MISFIT = 0.75
"""A constant level at the start of a record is accepted only if it reduces the sum of squared residuals of a fit to
less than this fraction of the sum without it (conventional)."""
LEAST_SCATTER = 0.02
"""Smallest standard deviation of ln A (A is the amplitude) of a block of readings that is assumed before the noise is
inferred. It allows for errors of the damping laws and of the detector (conventional)."""
EARLY_FRACTION = 0.1
"""Fraction of the blocks of readings, at the start of the decay, that are compared with their prediction by the later
blocks. Blocks that do not agree are left out of the decay."""
SURPRISE_SDS = 4.5
"""A block of readings early in a decay does not belong to the decay if it, or a sum of up to eight neighbouring blocks,
differs by more than this many standard deviations from its prediction by the later blocks. By chance this occurs once
in 30,000 records."""


@dataclass(frozen=True, eq=False)
class Curve:
    """A decay and its fit in dB for figures, as arrays of shape (n,) for n blocks of readings.

    Attributes
    ----------
    t
        Times of the blocks in s, as in the record.
    level
        Mean level of the readings in each block in dB, as in the record (see `Blocks.x`).
    fit
        Level of the fit in dB, which includes the deviation from the damping law.
    fit_sd
        Posterior standard deviation of the fit in dB.
    scatter
        Standard deviation of the noise of a block in dB, for the first of the possible noises (without a slow part of
        the noise floor).
    """

    t: np.ndarray
    level: np.ndarray
    fit: np.ndarray
    fit_sd: np.ndarray
    scatter: np.ndarray


@dataclass(frozen=True, eq=False)
class Decay:
    """The free decay of an envelope, with its readings averaged in blocks.

    Attributes
    ----------
    record
        The record.
    window
        The window of the free decay in the record.
    blocks
        The readings in the window, averaged in blocks, with their possible noises.
    reference
        ln of the reference amplitude A_ref in the record's unit (for powers, of their root); for levels in dB, ln of
        its ratio to the amplitude at 0 dB.
    """

    record: EnvelopeRecord
    window: EnvelopeWindow
    blocks: Blocks
    reference: float

    @property
    def readings(self) -> int:
        """Number of readings of the record (not of blocks) in the window of the decay."""
        return self.window.stop - self.window.start

    @property
    def fall(self) -> float:
        """Decrease of the level in dB: mean over the first thirtieth of the decay minus that over the last."""
        top, bottom = self.blocks.ends
        return (top - bottom) * NEPER

    def amplitude(self, x: float) -> tuple[float, str]:
        """Return the recorded quantity at x = ln(A/A_ref), in the record's unit, and this unit.

        For a record in dB the quantity is the level in dB, for a record of powers it is the power.
        """
        value, unit = self.record.amplitude((x + self.reference) * NEPER)
        return float(value), unit

    def curve(self, fit: np.ndarray, sd: np.ndarray) -> Curve:
        """Return the measured levels of this decay and those of a fit, in dB as the record states them, for figures.

        fit, sd: fitted ln(A/A_ref) at the n blocks of readings, and its standard deviation, (n,) each.
        """
        b, t = self.blocks, self.record.t[self.window.start : self.window.stop]
        # The times of the blocks start at the middle of the first block.
        start = float(t.min()) + 0.5 * (b.t[1] - b.t[0]) * (b.each > 1)
        level, fitted = ((x + self.reference) * NEPER for x in (b.x, fit))
        return Curve(b.t + start, level, fitted, sd * NEPER, np.sqrt(np.diag(b.noises[0][1])) * NEPER)

    def misfit(self, fit: np.ndarray) -> tuple[float, float]:
        """Return the root mean square residual of a fit in excess of the noise, and the root mean square of the noise.

        Both are differences of ln A, which are relative to the amplitude A. In their mean squares each block has its
        squared fitted amplitude as weight. The weighted mean of the residuals is subtracted first. The excess is the
        root of the mean square of the residuals minus that of the noise; it is 0 if this difference is negative. The
        noise is the first of the possible ones, without a slow part of the noise floor. fit: fitted ln(A/A_ref) at the
        blocks, (n,).
        """
        weight = np.exp(2.0 * fit)
        weight = weight / weight.sum()
        off = self.blocks.x - fit
        off = off - weight @ off
        square, noise = float(weight @ off**2), float(weight @ np.diag(self.blocks.noises[0][1]))
        return float(np.sqrt(max(square - noise, 0.0))), float(np.sqrt(noise))


def free_decay(
    record: EnvelopeRecord, window: EnvelopeWindow | None, sums: Sequence[tuple[str, ...]]
) -> tuple[Decay, tuple[Sum, ...]]:
    """Find the free decay of an envelope, infer its noise, and prepare the sums of damping terms for it.

    Parameters
    ----------
    record : EnvelopeRecord
        The envelope.
    window : EnvelopeWindow or None
        The window of the decay, which is then used unchanged; None to find it.
    sums : sequence of tuple of str
        Names of the terms of each sum.

    Returns
    -------
    Decay
        The decay with its possible noises; it ends above the noise floor, unless `window` is given.
    tuple of Sum
        The sums, with the amplitude and frequency of this decay, on which the priors of their terms' parameters depend
        (1 if no term needs them).

    Raises
    ------
    Refusal
        If there is no window with a decay, or if the level decreases by less than `LEAST_DROP` dB.
    InputError
        If a term of a sum dissipates no energy, or needs a frequency, or an amplitude in rad or m, that is unknown.
    """
    chosen = window or find_window(record.t, record.level)
    first, stop, why = chosen.start, chosen.stop, list(chosen.why)
    for _ in range(MOST_WINDOW_CHANGES):
        b, _ = _blocks(record, chosen)
        size = chosen.stop - chosen.start
        held_level = held_blocks(b) if window is None else 0
        if held_level == 0:
            break
        chosen = replace(chosen, start=chosen.start + held_level * size // b.t.size)
    tries = 0
    while True:
        b, reference = _blocks(record, chosen)
        # The priors of some terms' parameters depend on the amplitude at the start of the decay.
        start, plain = b.ends[0], {*sums} <= {*SUMS, *FORMS}
        scale = Scale() if plain else scale_of(record, sums, start + reference)
        low = float(b.x.min())
        asked = tuple(Sum(terms, start, low, scale, is_other_form(terms, sums)) for terms in sums)
        b, later, end = infer_noises(b, asked)
        size = chosen.stop - chosen.start
        if window is not None or size < FEW_READINGS or tries == MOST_WINDOW_CHANGES:
            break
        within = end * size // b.t.size
        if later == 0 and (chosen.floor is not None or size - within < LEAST_SHORTENING * size):
            break
        behind = chosen.stop if within < FEW_READINGS or later > 0 else chosen.start + within
        chosen = replace(chosen, start=chosen.start + later * size // b.t.size, stop=behind)
        tries += 1
    if chosen.start > first:
        begins = record.t[chosen.start]
        why[0] = f"starts at {begins:.4g} s, because the readings before it do not fit the decay"
    if chosen.stop < stop:
        last = f"{record.t[chosen.stop - 1]:.4g} s"
        why[1] = (
            f"ends at {last}, {ABOVE_FLOOR:g} dB above the noise floor that the scatter of the readings shows"
        )
    return Decay(record, replace(chosen, why=tuple(why)), b, reference), asked


def _blocks(record: EnvelopeRecord, window: EnvelopeWindow) -> tuple[Blocks, float]:
    """Return the readings of a window averaged in blocks, and ln of the reference amplitude A_ref in the record's unit.

    The level of A_ref in dB is halfway between the levels at the start and at the end. For levels in dB, A_ref is
    relative to the amplitude at 0 dB. The noise of the blocks is not inferred here. Raises Refusal if the level
    decreases by less than `LEAST_DROP` dB.
    """
    whole = slice(window.start, window.stop)
    t, x, _ = average_in_blocks(record.t[whole], record.level[whole] / NEPER, MOST_BLOCKS)
    edge = max(1, t.size // 30)
    top, bottom = x[:edge].mean(), x[-edge:].mean()
    drop = NEPER * float(top - bottom)
    if not drop >= LEAST_DROP:
        raise Refusal(
            f"between {record.t[window.start]:.4g} and {record.t[window.stop - 1]:.4g} s the level decreases by "
            f"only {max(drop, 0.0):.1f} dB; at least {LEAST_DROP:g} dB are needed"
        )
    reference = 0.5 * float(top + bottom)
    duration = float(t[-1] - t[0])
    floor = None if window.floor is None else window.floor.scaled(np.exp(-2.0 * reference))
    mean_rate = float(top - bottom) / (duration * (1.0 - edge / t.size))
    each = (window.stop - window.start) / t.size
    frequency = 2.0 * np.pi * record.frequency if record.frequency else None
    return Blocks(t - t[0], x - reference, duration, mean_rate, floor, each, frequency), reference


def held_blocks(b: Blocks) -> int:
    """Return the number of blocks at the start with a constant level (a drive is still on); 0 if there are none.

    Fits with a constant level, followed by a decay with viscous, Coulomb and quadratic damping, are compared with two
    fits without it: a decay with these three terms, and a power law. A constant level is accepted if the misfit with it
    is much smaller than without it (`HELD_MISFIT`). With fewer than `LEAST_BLOCKS_HELD` blocks the result is 0.
    """
    n = b.t.size
    if n < LEAST_BLOCKS_HELD:
        return 0
    visible = np.sqrt(b.floor.power) if b.floor is not None else 0.0
    law = Sum(SUMS[-1], b.ends[0], float(b.x.min())).law()
    inverse = np.diag(1.0 / np.maximum(LEAST_SCATTER, np.exp(-b.x) * visible))

    def misfit(held_level: int) -> float:
        """Return the sum of squared residuals of a fit whose level is constant up to the block with this index."""
        held = replace(b, t=np.maximum(b.t - b.t[held_level], 0.0))
        return fit_rates(held, law, inverse).squares

    tried = range(FIRST_END, n // 2, END_STEP if n >= SPARSE_READINGS else 1)
    misfits = [misfit(end) for end in tried]
    best = int(np.argmin(misfits))
    # If friction increases as the amplitude decreases, the decay resembles a constant level at its start. The power
    # law dA/dt ∝ −A^p with p < 0 describes such a decay.
    whole = min(misfit(0), fit_power(b, inverse).squares)
    return tried[best] + 1 if misfits[best] < HELD_MISFIT * whole else 0


def infer_noises(b: Blocks, sums: Sequence[Sum] = ()) -> tuple[Blocks, int, int]:
    """Infer the noise of a decay without assuming one damping law, and find blocks that do not belong to the decay.

    Parameters
    ----------
    b : Blocks
        The readings.
    sums : sequence of Sum
        Sums of damping terms that may describe the decay; only those with a term other than viscous, Coulomb and
        quadratic damping have an effect.

    Returns
    -------
    blocks : Blocks
        The blocks with their possible noises: one for each value of the slow fraction of the noise floor
        (`SLOW_FRACTIONS`), one that is inferred together with a deviation from the damping law, and one whose scatter
        is slower. Their x is corrected for the curvature of the decay within a block. Their `inverse` is for the
        covariance of the most probable noise and of the deviation from the law together.
    later : int
        Number of blocks at the start, up to the last one that disagrees with its prediction by the later blocks (see
        `SURPRISE_SDS`). It is 0 if all agree, or if there are fewer than 30 blocks.
    end : int
        Number of blocks before the first one whose fit is less than `ABOVE_FLOOR` dB above the inferred noise floor; n
        if there is none.
    """
    n = b.t.size
    visible = np.sqrt(b.floor.power) if b.floor is not None else 1e-3
    rough = np.diag(1.0 / np.maximum(LEAST_SCATTER, np.exp(-b.x) * visible))
    law, x0, rates = loosest_fit(b, sums, rough)
    fit = law.solve(b.t, x0, rates)[0]
    # `curvature` is the mean of the fitted ln A over a block minus its value in the middle, to second order.
    off = np.gradient(b.t) * np.sqrt(max(1.0 - b.each**-2, 0.0) / 12.0)
    before, after = (law.solve(b.t + shift, x0, rates)[0] for shift in (-off, off))
    # It is set to 0 in the block in which the oscillation comes to rest.
    curvature = np.where(after > LOG_AT_REST, 0.5 * (before + after) - fit, 0.0)
    b = replace(b, x=b.x - curvature)
    tangents = solver_of(b, law).solve(np.append(rates, x0), tangents=ALL).tangents
    columns, warp = tangents[:, :-KNOTS], tangents[:, -KNOTS:]
    early = max(1, round(EARLY_FRACTION * n)) if n >= 30 else 0
    rest = slice(early, n)
    given = (b.t[rest], (b.x - fit)[rest], fit[rest], columns[rest], warp[rest], b.floor)
    slow_time = 1.0 / b.mean_rate
    middle = infer_noise(*given, 0.5, slow_time, b.each)
    rivals = [
        infer_noise(*given, slow, slow_time, b.each, begin=middle, only_floor=True) for slow in SLOW_FRACTIONS
    ]
    best = max(rivals, key=lambda noise: noise.log_density)
    loose = infer_noise(*given, best.slow, slow_time, b.each, with_deviation=True, begin=best)
    rivals += [loose, best.slower(b.duration)]
    noises = tuple((noise, noise.covariance(b.t, fit)) for noise in rivals)
    smooth = loose.deviation * warp @ smooth_root(KNOTS, DEVIATION_LENGTH)
    whole = best.covariance(b.t, fit) + smooth @ smooth.T
    if best.constant > 0:
        floor = 0.5 * best.constant * np.exp(-2.0 * fit)
        whole = whole + np.outer(floor, floor)
    low = np.flatnonzero(np.exp(2.0 * fit) < 10.0 ** (ABOVE_FLOOR / 10.0) * best.floor)
    end = int(low[0]) if low.size else n
    later = 0  # number of early blocks, up to the last one that the later blocks do not predict
    if early:
        # Innovations backwards in time: each block minus its prediction from all later ones, in standard deviations.
        # The parameters of the law have wide priors.
        scale = columns / np.linalg.norm(columns, axis=0)
        triangle = np.linalg.cholesky((whole + 1e2 * scale @ scale.T)[::-1, ::-1])
        innovations = np.linalg.solve(triangle, (b.x - fit)[::-1])[::-1][:early]
        # Sums from each block to the last early one.
        total = np.append(np.cumsum(innovations[::-1])[::-1], 0.0)
        surprises = np.zeros(early, bool)
        for count in (1, 2, 4, 8):
            if count <= early:
                runs = early - count + 1
                sums_of_runs = np.abs(total[:runs] - total[count:])
                surprises[:runs] |= sums_of_runs > SURPRISE_SDS * np.sqrt(count)
        later = int(np.flatnonzero(surprises).max(initial=-1)) + 1
    return replace(b, noises=noises, inverse=np.linalg.inv(np.linalg.cholesky(whole))), later, end
