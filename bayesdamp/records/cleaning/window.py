"""Find where a free decay begins and ends in a record: after the release, and before the body is at rest."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from bayesdamp.formatting import time_span
from bayesdamp.records.cleaning.swings import (
    MAX_RISE,
    NOISE_ERRORS,
    Reason,
    Series,
    Swings,
    best_stretch,
    find_stretches,
    information,
)
from bayesdamp.records.oscillation.features import TurningPoints, resample, turning_points, without_gap_edges
from bayesdamp.records.oscillation.modes import few_samples, find_excited, find_other_motion
from bayesdamp.records.oscillation.noise import (
    LEAST_SHARE,
    coarse_periods,
    neighbourhoods,
    roughness,
    samples_a_cycle,
)
from bayesdamp.types import FreeDecay, InputError

# Unless a comment says otherwise, these thresholds were set on simulated and measured records.
MIN_STEPS = 2.0
"""A turning point closer to the midline than this many recording steps (steps to which the values are rounded) is not
used."""
MIN_SIGMAS = 2.0
"""A turning point closer to the midline than this many standard deviations of the noise is not used."""
FEWEST_A_CYCLE = 4.0
"""Smallest number of samples in a cycle with which an oscillation can be followed. If no free decay is found in a
record whose strongest oscillation has fewer, the record is reported as sampled too coarsely."""
CLEAR_SHARE = 0.85
"""If an oscillation with one of the possible periods explains more than this fraction of the record's variance, no
weaker period is tried."""
MOST_HEAD_SWINGS = 24
"""Largest number of swings (half cycles) at the start of a decay that are tested for a disturbance by comparison with
later ones; at most half of the decay's swings are tested."""
START_MARGIN = 0.2
"""If the body is released by hand in the middle of a swing (half cycle), the part that is used starts later than the
release by this fraction of the duration of a swing."""
HAND_REACH = 0.25
"""A hand may have shifted the first or the last turning point of a decay. This is assumed if the body moves just before
the first (or after the last) one, but the samples agree there with the free decay over less than this fraction of a
half cycle. The turning point is then not used."""
LEAST_TURNS = 6
"""Only in a decay with more than this many turning points, the first one may count as shifted by a hand (`HAND_REACH`),
and the motion long after the last one as a disturbance and not as rest. If the user gives only the start, a decay with
little `information` on the damping counts only if it begins soon after this start and has more turning points than
this."""
OTHER_INFORMATION = 0.1
"""Another part of the record counts as a free decay if its `information` on the damping (number of half cycles × ln of
the fall) is at least this fraction of that of the part that is used; with less it may be a hum in the noise."""
MIN_POWER_SHARE = 0.01
"""A record is refused if the half cycles of its decay have less than this fraction of the power (sum of squared ranges)
of all half cycles, except those of other free decays in the record (conventional)."""
LITTLE_INFORMATION = 1.0
"""The search for decays is repeated in the rate of change if the best has less `information` than this (conventional;
ten half cycles in which the amplitude falls by a tenth have 1.3)."""
LISTED_DECAYS = 3
"""Largest number of other free decays in the record whose times a note lists."""
MAX_DELAY, REST_FRACTION = 1.0, 0.2
"""A start that the user gives is refused if the body is at rest there: if the free decay begins more than `MAX_DELAY`
periods later, and the half cycles before it have less than `REST_FRACTION` of the range of its first half cycle."""
HELD_STILL, SURELY_FREE = 0.25, 0.9
"""A body counts as held at the start if it moves there by less than `HELD_STILL` times as much as a swinging one. The
part that is used then begins `SURELY_FREE` quarters of a period before it passes the first middle."""
FEW_TURNS = 30
"""In a decay with at most this many turning points, the used part may start between two turning points, so that up to
0.8 of a half cycle more is used; a longer decay starts at a turning point, or at the release."""
AVERAGED_SWINGS, MAX_NOISE_RISE = 6, 0.1
"""To measure narrow-band noise, the ranges (maximum minus minimum) of `AVERAGED_SWINGS` successive half cycles are
averaged. If this average rises again after it has fallen, the rise is attributed to noise only if it is below
`MAX_NOISE_RISE` times the largest average (`_largest_rise`)."""
LEAST_DRIVEN, LEAST_KINK, LEAST_FALL = 12, 8.0, 0.01
"""An oscillation that a drive keeps constant before it is released: at least `LEAST_DRIVEN` half cycles, until the
amplitude falls by the fraction `LEAST_FALL`. As many half cycles later, it has fallen `LEAST_KINK` times as much as
among them (conventional)."""
SECOND_SIZE = 0.05
"""A motion that is not the free decay of one oscillator (`OtherMotion`) is used without a search for a free decay if
its `size` is at least this: for two oscillations, the ratio of the second amplitude to the first; for a growing one,
the relative growth of the amplitude."""
BEGIN_ANYWHERE = ("steady", "excited")
"""Kinds of motion (`OtherMotion.kind`) with a constant amplitude, or with excitation throughout. For these, the used
part need not begin at the largest value of the record."""
LATE_PEAK = 0.5
"""The test whether a record is something other than the free decay of one oscillator begins at the record's largest
value. If this value comes after this fraction of the samples, the test uses the whole record."""


@dataclass(frozen=True)
class DecayWindow:
    """The part of a record that is used.

    Attributes
    ----------
    first, last
        Index of the first and of the last sample (both included).
    notes
        Sentences on why this part was chosen.
    decays
        All free decays in the record, including the used one, in time order; empty if the record is not a free decay.
    """

    first: int
    last: int
    notes: tuple[str, ...]
    decays: tuple[FreeDecay, ...] = ()


@dataclass(frozen=True)
class _Decays:
    """The turning points of a record, its stretches of free decay, and the stretch to use (`best_stretch`).

    stretches, best: each stretch as index of its first turning point, and 1 + index of its last one. noise: standard
    deviation of the noise of a sample. period: period in s. floor: smallest distance of a turning point from the
    midline; closer ones are noise. noise and floor are in the unit of the values.
    """

    turns: TurningPoints
    stretches: list[tuple[int, int]]
    best: tuple[int, int]
    noise: float
    period: float
    floor: float

    @property
    def best_turns(self) -> TurningPoints:
        return self.turns.cut(*self.best)

    def is_relevant(self, stretch: tuple[int, int]) -> bool:
        """Return whether a stretch has enough information on the damping to count as another free decay.

        It needs `OTHER_INFORMATION` times the `information` of the best stretch; with less it may be a hum in the
        noise. stretch: index of its first turning point, and 1 + index of its last one."""
        return information(self.turns, stretch) >= OTHER_INFORMATION * information(self.turns, self.best)


def window_of_other_motion(t: np.ndarray, y: np.ndarray, period: float) -> DecayWindow | None:
    """Return the part to use of a record that is not the free decay of one oscillator; None for other records.

    Such a record contains two oscillations, or one that grows, stays constant, or is excited throughout
    (`find_other_motion`). The part begins at the value farthest from the median, or at the start of the record, and
    ends with the record. The result is None also if the second oscillation or the growth is small (`SECOND_SIZE`), or
    if fewer than 20 samples are left.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    period
        Approximate period of the oscillation, s.
    """
    largest = int(np.argmax(np.abs(y - np.median(y))))
    first = largest if largest < LATE_PEAK * t.size else 0
    if t.size - first < 20:
        return None
    motion = find_other_motion(t[first:], y[first:], period)
    if motion is None or motion.kind in BEGIN_ANYWHERE:
        # The motion need not begin at the largest value: search in the whole record.
        whole = (
            find_excited(*few_samples(t, y, period), period)
            if motion is None
            else find_other_motion(t, y, period)
        )
        if whole is not None and whole.kind in BEGIN_ANYWHERE:
            first, motion = 0, whole
    if motion is None or motion.size < SECOND_SIZE:
        return None
    note = f"It is not the free decay of one oscillator, so it is used from {t[first]:.4g} s to its end."
    return DecayWindow(first, t.size - 1, (note,))


def free_decay(
    t: np.ndarray,
    y: np.ndarray,
    periods: Sequence[tuple[float, float]],
    step: float,
    seek_start: bool,
    seek_stop: bool,
    name: str,
) -> DecayWindow:
    """Return the part of a record that is a free decay; of several, the best (`best_stretch`).

    If the user gives only the start, this part ends before the next hit or release.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    periods
        Possible periods in s, each with the fraction of the variance that an oscillation with this period explains, as
        `coarse_periods` returns them.
    step
        Step to which the values are rounded, in the unit of y; 0 for none.
    seek_start, seek_stop
        Whether to search for the start and for the stop of the decay; if not, the decay begins or ends with the given
        samples.
    name
        Name of the record in messages.

    Raises
    ------
    InputError
        If nothing oscillates, or the record is sampled too coarsely; if start and stop are sought and the decay has
        only a small fraction of the power of all half cycles; or if the body is at rest at a given start.
    """
    decays = _find_decays(t, y, periods, step, name)
    if seek_start and seek_stop:
        times, (a, b) = decays.turns.times, decays.best
        power = np.median(neighbourhoods(np.abs(np.diff(decays.turns.values)), 3), axis=1) ** 2
        own, loudest = float(power[a : b - 1].sum()), int(np.argmax(power))
        for first, last in decays.stretches:
            if (first, last) != decays.best and decays.is_relevant((first, last)):
                power[first : last - 1] = 0.0
        share = own / max(float(power.sum()), 1e-300)
        if share < MIN_POWER_SHARE:
            raise InputError(
                f"its largest half cycles, near {times[loudest]:.4g} s, are not part of a free decay; the decay from "
                f"{time_span(times[a], times[b - 1])} has only {100 * share:.1g} % of the power; if there are several "
                "modes, band-pass filter the record around one, else give start and stop",
                name,
            )
    if not seek_start and seek_stop:
        end = _next_release(t, decays, name)
        if end < t.size - 1:
            before, values = t[: end + 1], y[: end + 1]
            window = free_decay(before, values, coarse_periods(before, values), step, False, True, name)
            note = f"From {t[end]:.6g} s on it is struck or released again; what follows is not used."
            return replace(window, notes=(*window.notes, note))
    grid, values, _ = resample(t, y, decays.period, smooth=False)
    grid, values = grid[grid <= t[-1]], values[grid <= t[-1]]
    series = Series(t, grid, values, step, decays.noise * float(np.sqrt(min(grid.size / t.size, 1.0))))
    head, why = _count_disturbed(t, y, decays, step)
    if head == 0 and any(end in (decays.best[0], decays.best[0] + 1) for _, end in decays.stretches):
        why = "amplitude"  # the range of the half cycles jumps at its start
    decay = decays.turns.cut(decays.best[0] + head, decays.best[1])
    notes: list[str] = []
    first, last = 0, t.size - 1
    if seek_start:
        floor = 2 * decays.noise + step
        before = float(decays.best_turns.times[head - 1]) if head else -np.inf
        driven = _count_driven(np.abs(np.diff(decay.values)), decays.noise)
        decay = decay.cut(driven, decay.times.size)
        if driven:
            first = int(np.searchsorted(t, decay.times[0]))
            notes.append(
                f"The start ({t[first]:.6g} s, sample {first} from 0) is where the amplitude has begun to fall; "
                "until then it is nearly constant, as in a driven oscillation. To use that part too, give the start."
            )
        else:
            first = _find_start(series, Swings(t, y, decay, floor), why, before, notes)
            if first < (free := _end_of_hold(series, decay, float(t[first]))):
                first = free
                notes[:] = [
                    f"The start ({t[first]:.6g} s, sample {first} from 0) is shortly after the release; before it the "
                    "body is held."
                ]
    if seek_stop:
        last, why_stop = _find_stop(series, decay, decays.floor)
        if why_stop:
            notes.append(f"The stop ({t[last]:.6g} s, sample {last} from 0) is {why_stop}")
    times = decays.turns.times
    used = FreeDecay(float(t[first]), float(t[last]))
    spans = [used]
    for a, b in decays.stretches:
        begin, end = float(times[a]), float(times[b - 1])
        is_apart = (a, b) != decays.best and (end <= used.start or begin >= used.stop)
        if is_apart and b - a >= 4 and decays.is_relevant((a, b)):
            spans.append(FreeDecay(begin, end))
    all_decays = tuple(sorted(spans, key=lambda span: span.start))
    notes += filter(None, [other_decays(all_decays, t[first], t[last])])
    return DecayWindow(first, last, tuple(notes), all_decays)


def _find_decays(
    t: np.ndarray, y: np.ndarray, periods: Sequence[tuple[float, float]], step: float, name: str
) -> _Decays:
    """Return the free decays with the best of the possible periods.

    The best period is that for which the best decay has the most `information` on the damping. Periods that explain
    less than `LEAST_SHARE` of the variance are not tried. If there is hardly a free decay with any of them
    (`LITTLE_INFORMATION`), the periods of the rate of change are tried too. The arguments are those of `free_decay`.
    Raises InputError if there is no free decay.
    """
    options: list[_Decays] = []

    def search(possible: Sequence[tuple[float, float]]) -> None:
        for period, share in possible:
            if share >= LEAST_SHARE and (decays := _decays_of_period(t, y, step, period)):
                options.append(decays)
            if share > CLEAR_SHARE and options:
                break

    def amount(decays: _Decays) -> float:
        return information(decays.turns, decays.best)

    search(periods)
    # A slow pull before the release may be larger than the oscillation, but its rate is small.
    if max(map(amount, options), default=0.0) < LITTLE_INFORMATION:
        search(coarse_periods(t[1:], np.diff(y) / np.diff(t)))
    if options:
        return max(options, key=amount)
    share = max(share for _, share in periods)
    each = samples_a_cycle(t, y)
    if each < FEWEST_A_CYCLE:
        f = 1 / (each * float(np.median(np.diff(t))))
        raise InputError(
            f"it is sampled too coarsely: its strongest oscillation, at {f:.3g} Hz, has {each:.2g} samples a "
            f"cycle; give a record with at least {FEWEST_A_CYCLE:.0f}, better 10",
            name,
        )
    if share < LEAST_SHARE:
        shown = f"the best sinusoid has {100 * share:.0f} % of the power"
        raise InputError(
            f"no oscillation stands out of the noise: {shown}; check column, start and stop", name
        )
    raise InputError(
        "no oscillation: fewer than three turning points are above noise and rounding; check column, start and stop",
        name,
    )


def _decays_of_period(t: np.ndarray, y: np.ndarray, step: float, period: float) -> _Decays | None:
    """Return all turning points and, among them, the free decays with about this period in s; None if there are none.

    Period and noise in the result are measured again, in the decay with the most `information` on the damping. t, y:
    times in s and values, (n,). step: step to which the values are rounded, in the unit of y.
    """
    noise = roughness(t, y, period)
    turns = without_gap_edges(turning_points(t, y, period, noise), t, period)
    sigmas = max(MIN_SIGMAS, NOISE_ERRORS * float(np.median(turns.gain))) if turns.gain.size else MIN_SIGMAS
    floor = max(MIN_STEPS * step, sigmas * noise)
    spans = find_stretches(t, turns, floor)
    if spans:  # measure the noise again within the best stretch, because it may differ from that at rest
        a, b = best_stretch(turns, spans)
        inside = slice(*np.searchsorted(t, (turns.times[a], turns.times[b - 1] + 1e-12)))
        noise = roughness(t[inside], y[inside], period) if t[inside].size >= 10 else noise
        decays = _Decays(turns, spans, (a, b), noise, period, floor)
        floor = max(MIN_STEPS * step, sigmas * noise, _largest_rise(decays))
        spans = find_stretches(t, turns, floor)
    if not spans:
        return None
    best = best_stretch(turns, spans)
    period = 2 * float(np.median(np.diff(turns.times[slice(*best)])))
    return _Decays(turns, spans, best, noise, period, floor)


def _largest_rise(decays: _Decays) -> float:
    """Measure narrow-band noise in the best decay: return how much the averaged range of its half cycles rises again.

    A filter leaves narrow-band noise, which raises some half cycles. The result is the largest rise of the average
    after it has fallen, in the unit of the values. The half cycles from the start of the decay on are used, as long as
    they are in phase with it and before the next release. The result is 0 if the rise is more than `MAX_NOISE_RISE`
    allows, as in beats, or if there are few half cycles.
    """
    turns, (first, end) = decays.turns, decays.best
    after = [a for a, b in decays.stretches if a >= end - 1 and decays.is_relevant((a, b))]
    last = after[0] if after else turns.times.size
    gaps = np.diff(turns.times[first:last])
    usual = float(np.median(gaps[: end - first]))
    astray = np.flatnonzero(np.abs(gaps[end - first - 1 :] - usual) > 0.4 * usual)
    last = end + int(astray[0]) if astray.size else last
    ranges = np.abs(np.diff(turns.values[first:last]))
    ranges = ranges[gaps[: ranges.size] < 1.6 * usual]  # leave out gaps in the samples
    if ranges.size < 4 * AVERAGED_SWINGS:
        return 0.0
    smooth = neighbourhoods(ranges, AVERAGED_SWINGS).mean(axis=1)
    falling = smooth[int(np.argmax(smooth)) :]
    rise = float((falling - np.minimum.accumulate(falling)).max())
    return rise if rise < MAX_NOISE_RISE * float(smooth.max()) else 0.0


def _next_release(t: np.ndarray, decays: _Decays, name: str) -> int:
    """Return the index of the last sample to use before the body is hit or released again.

    This is the sample at the last turning point before; without a hit or release, it is the last sample. It is used for
    a record whose start the user has given. t: times in s, (n,), from this start on. decays: the decays in it. name:
    name of the record, for messages.

    Raises InputError if the body is at rest at the start and is struck or released only later.
    """
    times, sizes = decays.turns.times, np.abs(np.diff(decays.turns.values))
    soon = t[0] + MAX_DELAY * decays.period
    starting = [
        (a, b)
        for a, b in decays.stretches
        if decays.is_relevant((a, b)) or (times[a] <= soon and b - a > LEAST_TURNS)
    ]
    first = starting[0][0]
    if times[first] > soon and sizes[: max(first - 1, 0)].max(initial=0.0) < REST_FRACTION * sizes[first]:
        raise InputError(
            f"hardly anything moves between the given start ({t[0]:.6g} s) and the release or hit near "
            f"{times[first]:.6g} s; give a start after it, or leave the start out",
            name,
        )
    for (_, end), (begin, _) in pairwise(starting):
        if sizes[begin] > (1 + MAX_RISE) * sizes[end - 2]:
            return _last_sample(t, times[end - 1])
    return t.size - 1


def other_decays(decays: Sequence[FreeDecay], start: float, stop: float) -> str:
    """Return a note with the times of the free decays outside of the used one; "" if there are none.

    start, stop: start and stop of the used decay, in s, on the clock of `decays`. The note lists at most
    `LISTED_DECAYS` decays.
    """
    others = [d for d in decays if d.stop <= start or d.start >= stop]
    if not others:
        return ""
    spans = ", ".join(time_span(d.start, d.stop) for d in others[:LISTED_DECAYS])
    more = len(others) - LISTED_DECAYS
    if len(others) == 1:
        return f"Another free decay is in the record and not used: {spans}; give its start and stop if it is wanted."
    tail = f" and {more} more" if more > 0 else ""
    return (
        f"{len(others)} other free decays are in the record and not used: {spans}{tail}; give the start and stop of "
        "one if it is wanted."
    )


def _count_disturbed(t: np.ndarray, y: np.ndarray, decays: _Decays, step: float) -> tuple[int, Reason | None]:
    """Return how many turning points to leave out at the start of the best decay, and the reason for the last one.

    The swings (half cycles) there disagree with the later ones. The number is the first index from which two successive
    swings agree with them (`Swings.reason_not_continuing`). Only half of the swings, at most `MOST_HEAD_SWINGS`, are
    tested. The result is (0, None) if none of these agrees, or if the first two agree.

    If a filter has smeared a hit, the swings before the hit grow. The test then begins at the number of growing swings
    minus one; if this is also the result, the reason is None.

    t, y: times in s and values, (n,). decays: the decays in the record. step: step to which the values are rounded, in
    the unit of y.
    """
    # `grown`: number of growing swings before a filtered hit. The ringing of the filter lasts as long after the hit.
    first = decays.best[0]
    sizes, gaps = np.abs(np.diff(decays.turns.values)), np.diff(decays.turns.times)
    grown = 0
    for i in range(first - 1, -1, -1):
        in_phase = 0.7 < gaps[i] / gaps[first] < 1 / 0.7
        if not in_phase or not REST_FRACTION * sizes[first] < sizes[i] < sizes[i + 1]:
            break
        grown += 1
    swings = Swings(t, y, decays.best_turns, 2 * decays.noise + step)
    most = min(MOST_HEAD_SWINGS, swings.gaps.size // 2)
    why: Reason | None = None
    for i in range(min(max(grown - 1, 0), most), most + 1):
        reason = swings.reason_not_continuing(i)
        next_reason = None if i + 1 > most else swings.reason_not_continuing(i + 1)
        if reason is None and next_reason is None:
            return i, why
        why = reason or next_reason
    return 0, None


def _count_driven(sizes: np.ndarray, noise: float) -> int:
    """Return how many half cycles at the start of a decay have a constant amplitude, as of a driven oscillation.

    From the next one on the amplitude must fall `LEAST_KINK` times as much as among them; under Coulomb damping it
    falls twice as much. The result is 0 if there are fewer than `LEAST_DRIVEN` such half cycles. sizes: ranges of the
    half cycles, (n,). noise: sd of the noise of a sample, in the same unit.
    """
    smooth = neighbourhoods(sizes, AVERAGED_SWINGS).mean(axis=1)
    level = np.cumsum(sizes) / np.arange(1, sizes.size + 1)
    below = smooth < level - np.maximum(4 * noise / AVERAGED_SWINGS**0.5, LEAST_FALL * level)
    falls = np.flatnonzero(below[LEAST_DRIVEN:]) + LEAST_DRIVEN
    if below[:LEAST_DRIVEN].any() or not falls.size:
        return 0
    flat, after = np.array_split(sizes[: falls[0]], 2), sizes[falls[0] : 2 * falls[0]]
    before = abs(float(flat[0].mean() - flat[1].mean())) + 6 * noise / falls[0] ** 0.5
    return int(falls[0]) if flat[1].mean() - after.mean() > LEAST_KINK * before else 0


def _find_start(series: Series, swings: Swings, why: Reason | None, before: float, notes: list[str]) -> int:
    """Return the index of the first sample of the free decay.

    The decay begins at the first of these points that is supported by the samples:

    - the start of the record, if the samples agree with the decay from there on;
    - the release, if the half cycle before the first of `swings` agrees with them over its whole duration;
    - a point within that half cycle, if its later part agrees with them;
    - the first turning point of `swings`, or the second one if a hand may have moved the first.

    Unless it is the start of the record, a note on the choice is appended to `notes`.

    series: the record. swings: the half cycles of the decay without disturbed ones. why: property in which the half
    cycle before them disagrees with the later ones; None if there is none. (If it is "amplitude" or "midline", the
    second and third points are not considered.) before: time (s) of the turning point at which that half cycle begins;
    −∞ if it is not in the decay.
    """
    t, decay = series.t, swings.turns
    gap, far = float(swings.gaps[0]), series.reach(decay)
    begins_late = far.at - t[0] > 1.01 * series.spacing
    if far.whole and not begins_late and swings.opens_like_later(far.at):
        return 0
    at, what = float(decay.times[0]), "the first turning point of the free decay"
    if why in (None, "period", "shape"):  # a part of the half cycle before may be undisturbed
        if far.whole and begins_late and abs(far.at - before) >= 0.08 * gap:
            at, what = far.at, "the release"
        elif not far.whole and decay.times.size <= FEW_TURNS and far.share > 0.5:
            at = far.at + START_MARGIN * gap
            what = "where the motion begins to agree with the later half cycles"
    touched = not far.whole and far.share < HAND_REACH and decay.times.size > LEAST_TURNS
    if (
        at == decay.times[0]
        and touched
        and series.moves(at - START_MARGIN * gap, at, float(swings.ranges[0]))
    ):
        at = float(decay.times[1])  # a hand that moves the body to its turning point may release it later
    first = int(np.searchsorted(t, at - 1e-12))
    notes.append(
        f"The start ({t[first]:.6g} s, sample {first} from 0) is {what}: "
        "before it the record shows rest, a hand or a disturbed release, which is not part of the free decay."
    )
    return first


def _end_of_hold(series: Series, decay: TurningPoints, start: float) -> int:
    """Return the index of the first sample that is surely after the release if the body is held at the start; else 0.

    A body that is released at rest passes the middle to the next turning point after at most half of the time in which
    it then passes the next middle (a quarter of a period). It was held if it needs longer, and moves until then by less
    than `HELD_STILL` times as much as one that still swings to its first turning point.

    series: the record. decay: turning points of the free decay. start: time in s at which it seems to start.
    """
    at_start = float(np.interp(start, series.grid, series.values))
    far = np.abs(decay.values - at_start) > 0.5 * float(np.ptp(decay.values[:3]))
    k = int(np.argmax(far))
    if not far[k] or k + 1 == far.size:
        return 0
    passed = []
    for begin, value, i in ((start, at_start, k), (float(decay.times[k]), float(decay.values[k]), k + 1)):
        part = (series.grid >= begin) & (series.grid <= decay.times[i])
        off = (series.values[part] - 0.5 * (value + decay.values[i])) * np.sign(value - decay.values[i])
        if not np.any(off < 0):
            return 0
        passed.append(float(series.grid[part][np.argmax(off < 0)]))
    quarter = 0.5 * (passed[1] - passed[0])
    held = series.values[(series.grid >= start) & (series.grid <= passed[0] - quarter)]
    if held.size < 2:
        return 0
    swing = 0.5 * abs(at_start - float(decay.values[k]))
    expected = swing * (1 - np.cos(np.pi / 2 * min((passed[0] - start) / quarter - 1, 2.0)))
    slack = 2 * series.step + NOISE_ERRORS * series.noise
    if expected < 4 * slack or np.ptp(held) - slack > HELD_STILL * expected:
        return 0
    return int(np.searchsorted(series.t, passed[0] - SURELY_FREE * quarter))


def _find_stop(series: Series, decay: TurningPoints, floor: float) -> tuple[int, str]:
    """Return the index of the last sample of the free decay, and the reason for this choice as a clause.

    The reason is "" if the decay ends with the record. series: the record. decay: turning points of the free decay.
    floor: smallest distance of a turning point from the midline, in the unit of the values; closer ones are noise.
    """
    t, times, values = series.t, decay.times, decay.values
    k = times.size - 1
    gap = float(np.median(np.diff(times)[-5:]))
    before = float(abs(values[k] - values[k - 1]))
    after = series.values[(series.grid > times[k] + 0.1 * gap) & (series.grid < times[k] + 0.9 * gap)]
    still = max(2 * series.step + 4.5 * series.noise, 0.1 * before)
    left = float(t[-1] - times[k])
    if left > 0.8 * gap and k >= 3 and before > 4 * floor and np.abs(after - values[k]).max() <= still:
        why = (
            "the last turning point from which the body swings back; in the next half cycle it comes to rest."
        )
        return _last_sample(t, times[k - 1]), why
    later = series.values[(series.grid > times[k] + gap) & (series.grid < times[k] + 3 * gap)]
    reversed_turns = TurningPoints(-times[::-1], values[::-1], decay.gain[::-1])  # treat the end as a start
    reversed_series = replace(series, grid=-series.grid[::-1], values=series.values[::-1])
    if left <= 1.2 * gap:
        if k < 4 or left < 0.2 * gap or reversed_series.reach(reversed_turns).whole:
            return t.size - 1, ""
    elif not (k >= LEAST_TURNS and before > 4 * floor and float(np.ptp(later)) > 0.25 * before):
        why = "the last turning point above noise and rounding; after it the body is nearly at rest."
        return _last_sample(t, times[k]), why
    # A hand, a hit or a stop ends the decay.
    last = float(times[k])
    touched = reversed_series.reach(reversed_turns).share < HAND_REACH and reversed_series.moves(
        -last - START_MARGIN * float(times[k] - times[k - 1]), -last, before
    )
    why = "the last undisturbed turning point; what follows does not continue the free decay."
    return _last_sample(t, float(times[k - 1 if touched else k])), why


def _last_sample(t: np.ndarray, at: float) -> int:
    """Return the index of the last sample, at times t (n,), that is not later than the time `at` (s)."""
    return int(np.searchsorted(t, at + 1e-12)) - 1
