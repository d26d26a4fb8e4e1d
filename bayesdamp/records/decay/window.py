"""Where a free decay begins and ends in a record: after the release, before the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import median_filter

from bayesdamp.provenance import FreeDecay
from bayesdamp.records.decay.continuation import Reach, Reason, Swings, reach
from bayesdamp.records.decay.stretches import RISE, stretches, unsteadiness, worth
from bayesdamp.records.oscillation.features import without_edges
from bayesdamp.records.oscillation.rough import roughness
from bayesdamp.records.oscillation.spectrum import coarse_periods, samples_a_cycle
from bayesdamp.records.oscillation.turning import Turning, thinned, turning_points
from bayesdamp.types import InputError

STEPS = 2.0
"""A turning point nearer to the midline than so many recording steps tells nothing of the damping."""
SIGMAS = 2.0
"""The same in standard deviations of the noise."""
ERRORS = 4.0
"""The same in standard errors of a turning value: noise itself has turning points of one or two."""
SHARE = 0.3
"""Share that an oscillation must have in a record, beyond what white noise would give."""
FEWEST_A_CYCLE = 4.0
"""Samples in a cycle from which it can be followed."""
CLEAR = 0.85
"""Share from which on no other period is tried."""
HEAD = 24
"""Swings at the head of a stretch that are set against the later ones, at most half of them."""
MARGIN = 0.2
"""Share of a swing that is left out after a hand where a start lies in the midst of a swing."""
STILL = 0.02
"""Share of the first swing by which a record moves that a hand moves."""
TOUCHED = 0.25
"""Share of a swing from a turning point within which a hand that still moves may have shifted it."""
LEAST_BEFORE = 6
"""Turning points before a hole by which its first swings are judged."""
OTHER = 0.1
"""Of what the used stretch tells of the damping, the share from which another is a free decay and not what hums on in
the noise."""
TAIL = 0.01
"""Share of the power of all swings below which a decay is a tail that says little of the record (conventional)."""
NAMED = 3
"""Other free decays that are named by their times; more are counted."""
LATE, LOW = 1.0, 0.2
"""Periods after a given start within which a free decay must begin, and the share of its first swing below which it is
at rest before."""
FEW = 30
"""Swings below which half a swing more is worth a start in its midst."""


@dataclass(frozen=True)
class Window:
    """First and last sample (counted from 0, both kept), why, in sentences, and all free decays of the record."""

    first: int
    last: int
    notes: tuple[str, ...]
    decays: tuple[FreeDecay, ...] = ()


@dataclass(frozen=True)
class _Found:
    """The turning points of a record, its stretches of free decay, and the noise that they were told by."""

    turns: Turning
    stretches: list[tuple[int, int]]
    best: tuple[int, int]
    noise: float
    period: float
    floor: float

    @property
    def decay(self) -> Turning:
        return self.turns.cut(*self.best)


@dataclass(frozen=True)
class _Series:
    """A record's times t (n,) in s, and its values (m,) on an equally spaced grid (m,) with their noise and step."""

    t: np.ndarray
    grid: np.ndarray
    values: np.ndarray
    step: float
    noise: float

    @property
    def spacing(self) -> float:
        return float(self.grid[1] - self.grid[0])

    def reach(self, turns: Turning) -> Reach:
        return reach(self.grid, self.values, turns, self.step, self.noise)

    def turned(self) -> _Series:
        """The same with the time running backwards."""
        return replace(self, grid=-self.grid[::-1], values=self.values[::-1])


def free_decay(
    t: np.ndarray, y: np.ndarray, step: float, seek_start: bool, seek_stop: bool, name: str
) -> Window:
    """The window of a record t (s), y, shape (n,), in which it decays freely.

    step: the recording step in the unit of y. seek_start, seek_stop: which of the two ends to look for; the
    other stays. Of several free decays it is the one that tells most of the damping. Raises InputError where nothing
    oscillates.
    """
    found = _found(t, y, step, name)
    if seek_start and seek_stop:
        _check_share(found, name)
    if not seek_start and seek_stop:
        again = _next_release(t, found, name)
        if again < t.size - 1:
            window = free_decay(t[: again + 1], y[: again + 1], step, False, True, name)
            note = f"From {t[again]:.6g} s on it is struck or released again; what is after that is not used."
            return replace(window, notes=(*window.notes, note))
    grid, values, _ = thinned(t, y, found.period, smooth=False)
    grid, values = grid[grid <= t[-1]], values[grid <= t[-1]]
    series = _Series(t, grid, values, step, found.noise * float(np.sqrt(min(grid.size / t.size, 1.0))))
    head, why = _head(t, y, found, step)
    if head == 0 and any(end in (found.best[0], found.best[0] + 1) for _, end in found.stretches):
        why = "amplitude"  # it is cut off from swings before it that are in step with it
    decay = found.turns.cut(found.best[0] + head, found.best[1])
    notes: list[str] = []
    first, last = 0, t.size - 1
    if seek_start:
        floor = 2 * found.noise + step
        before = float(found.decay.times[head - 1]) if head else None
        first = _start(series, Swings(t, y, decay, floor), why, before, notes)
    if seek_stop:
        last, why_stop = _stop(series, decay, found)
        if why_stop:
            notes.append(f"The stop ({t[last]:.6g} s, sample {last} from 0) is {why_stop}")
    decays = _all_decays(t, found, first, last)
    notes += filter(None, [other_decays(decays, t[first], t[last])])
    return Window(first, last, tuple(notes), decays)


def _check_share(found: _Found, name: str) -> None:
    """Raise InputError where the best stretch has a small share of the power of all swings outside other decays."""
    times, (a, b) = found.turns.times, found.best
    power = median_filter(np.abs(np.diff(found.turns.values)), 3, mode="nearest") ** 2
    kept, loudest = float(power[a : b - 1].sum()), int(np.argmax(power))
    least = OTHER * worth(found.turns, found.best)
    for first, last in found.stretches:
        if (first, last) != found.best and worth(found.turns, (first, last)) >= least:
            power[first : last - 1] = 0.0
    share = kept / max(float(power.sum()), 1e-300)
    if share < TAIL:
        raise InputError(
            f"its largest swings, near {times[loudest]:.4g} s, are not the decay of one oscillation; what decays, from "
            f"{times[a]:.4g} to {times[b - 1]:.4g} s, has {100 * share:.1g} % of their power; if it has several modes, "
            "band-pass it around one first, else give start and stop",
            name,
        )


def _next_release(t: np.ndarray, found: _Found, name: str) -> int:
    """Return the last sample before the next hit or release in a record that starts where the user said.

    Raises InputError where nothing oscillates at its beginning, and it is struck or released only later.
    """
    times, sizes = found.turns.times, np.abs(np.diff(found.turns.values))
    least, soon = OTHER * worth(found.turns, found.best), t[0] + LATE * found.period
    here = [
        (a, b)
        for a, b in found.stretches
        if (a, b) == found.best
        or worth(found.turns, (a, b)) >= least
        or (times[a] <= soon and b - a > LEAST_BEFORE)
    ]
    first = here[0][0]
    if times[first] > soon and sizes[: max(first - 1, 0)].max(initial=0.0) < LOW * sizes[first]:
        raise InputError(
            f"hardly anything swings between the start given ({t[0]:.6g} s) and the release or hit near "
            f"{times[first]:.6g} s; give a start from there on, or leave it out",
            name,
        )
    for (_, end), (begin, _) in pairwise(here):
        if sizes[begin] > (1 + RISE) * sizes[end - 2]:
            return _index(t, times[end - 1])
    return t.size - 1


def other_decays(decays: Sequence[FreeDecay], start: float, stop: float) -> str:
    """Say which free decays lie outside of the one that is used, start to stop in s; empty where none does."""
    others = [d for d in decays if d.stop <= start or d.start >= stop]
    if not others:
        return ""
    spans = ", ".join(f"{d.start:.4g} to {d.stop:.4g} s" for d in others[:NAMED])
    more = len(others) - NAMED
    if len(others) == 1:
        return f"Another free decay is in the record and not used: {spans}; start and stop choose it."
    tail = f" and {more} more" if more > 0 else ""
    return f"{len(others)} other free decays are in the record and not used: {spans}{tail}; start and stop choose one."


def _found(t: np.ndarray, y: np.ndarray, step: float, name: str) -> _Found:
    """The stretches of free decay of a record. Raises InputError where nothing oscillates."""
    seen: list[_Found] = []
    periods = coarse_periods(t, y, float(t[-1] - t[0]))
    for period, share in periods:
        if share >= SHARE and (one := _decays(t, y, step, period)):
            seen.append(one)
        if share > CLEAR and seen:
            break
    if not seen:
        share = max(share for _, share in periods)
        each = samples_a_cycle(t, y)
        if each < FEWEST_A_CYCLE:
            f = 1 / (each * float(np.median(np.diff(t))))
            raise InputError(
                f"it is sampled too coarsely: its strongest oscillation, at {f:.3g} Hz, has {each:.2g} samples a "
                f"cycle; give a record with {FEWEST_A_CYCLE:.0f} or more, better 10",
                name,
            )
        if share < SHARE:
            raise InputError(
                f"no oscillation stands out of the noise (share of the best sinusoid {share:.2f})",
                name,
            )
        raise InputError(
            "no oscillation: fewer than three turning points stand out of noise and rounding",
            name,
        )
    return max(seen, key=lambda one: worth(one.turns, one.best))


def _decays(t: np.ndarray, y: np.ndarray, step: float, period: float) -> _Found | None:
    """The stretches of free decay at about a period in s, if there are any."""
    noise = roughness(t, y, period)
    turns = without_edges(turning_points(t, y, period, noise), t, period)
    sigmas = max(SIGMAS, ERRORS * float(np.median(turns.gain))) if turns.gain.size else SIGMAS
    floor = max(STEPS * step, sigmas * noise)
    found = stretches(t, turns, floor)
    if found:  # the noise at rest says little of the noise in motion
        a, b = max(found, key=lambda s: worth(turns, s))
        inside = slice(*np.searchsorted(t, (turns.times[a], turns.times[b - 1] + 1e-12)))
        noise = roughness(t[inside], y[inside], period) if t[inside].size >= 10 else noise
        floor = max(STEPS * step, sigmas * noise, _unsteadiness(turns, found, (a, b)))
        found = stretches(t, turns, floor)
    if not found:
        return None
    best = max(found, key=lambda s: worth(turns, s))
    period = 2 * float(np.median(np.diff(turns.times[slice(*best)])))
    return _Found(turns, found, best, noise, period, floor)


def _unsteadiness(turns: Turning, found: list[tuple[int, int]], best: tuple[int, int]) -> float:
    """Return the largest rise of the swings from the best stretch on, in step with it and before the next release."""
    first, end = best
    after = [a for a, b in found if a >= end - 1 and worth(turns, (a, b)) >= OTHER * worth(turns, best)]
    last = after[0] if after else turns.times.size
    gaps = np.diff(turns.times[first:last])
    usual = float(np.median(gaps[: end - first]))
    astray = np.flatnonzero(np.abs(gaps[end - first - 1 :] - usual) > 0.4 * usual)
    last = end + int(astray[0]) if astray.size else last
    return unsteadiness(np.abs(np.diff(turns.values[first:last])))


def _head(t: np.ndarray, y: np.ndarray, found: _Found, step: float) -> tuple[int, Reason | None]:
    """(turning points to leave out, in what the last of them breaks) at the head of the best stretch."""
    swings = Swings(t, y, found.decay, 2 * found.noise + step)
    most = min(HEAD, swings.gaps.size // 2)
    why: Reason | None = None
    for i in range(min(_onset(found), most), most + 1):
        here = swings.breaks(i)
        if here is None and (i + 1 > most or swings.breaks(i + 1) is None):
            return i, why
        why = here or swings.breaks(i + 1)
    return 0, None


def _onset(found: _Found) -> int:
    """Return how many swings at the head of the best stretch are the onset of a filtered hit.

    The ringing of a filter lasts about as long after the largest swing as before it.
    """
    first = found.best[0]
    sizes, gaps = np.abs(np.diff(found.turns.values)), np.diff(found.turns.times)
    grown = 0
    for i in range(first - 1, -1, -1):
        in_step = 0.7 < gaps[i] / gaps[first] < 1 / 0.7
        if not in_step or not LOW * sizes[first] < sizes[i] < sizes[i + 1]:
            break
        grown += 1
    return max(grown - 1, 0)


def _start(
    series: _Series, swings: Swings, why: Reason | None, before: float | None, notes: list[str]
) -> int:
    """The first sample of the free decay: the record's own, the release, or the first clean turning point.

    why: in what the swing before breaks the curve of the later ones. before: the turning point (s) that it begins at.
    """
    t, decay = series.t, swings.turns
    gap = float(swings.gaps[0])
    far = series.reach(decay)
    if far.whole and far.at - t[0] <= 1.01 * series.spacing and swings.opens_like_later(far.at):
        return 0
    at, what = float(decay.times[0]), "the first turning point of the free decay"
    if why in (None, "period", "shape"):  # of that swing some may be free, unless it was seen whole
        if (
            far.whole
            and far.at > t[0] + 1.01 * series.spacing
            and not (before and abs(far.at - before) < 0.08 * gap)
        ):
            at, what = far.at, "the release"
        elif not far.whole and decay.times.size <= FEW and far.share > 0.5:
            at, what = far.at + MARGIN * gap, "where it begins to follow its later swings"
    touched = not far.whole and far.share < TOUCHED and decay.times.size > LEAST_BEFORE
    if at == decay.times[0] and touched and _moves(series, at - MARGIN * gap, at, float(swings.ranges[0])):
        at = float(decay.times[1])  # a hand that brings it to its turning point may not let go there
    first = int(np.searchsorted(t, at - 1e-12))
    notes.append(
        f"The start ({t[first]:.6g} s, sample {first} from 0) is {what}: "
        "what is before it is rest, a hand or a disturbed release, which the later swings do not continue."
    )
    return first


def _moves(series: _Series, begin: float, end: float, swing: float) -> bool:
    """Return whether a record moves from begin to end, s, by more than noise, rounding and a small share of a swing."""
    part = series.values[(series.grid >= begin) & (series.grid <= end)]
    return part.size > 1 and float(np.ptp(part)) > STILL * swing + 2 * series.step + ERRORS * series.noise


def _stop(series: _Series, decay: Turning, found: _Found) -> tuple[int, str]:
    """Return the last sample of the free decay and why it is that: the record's, or the last clear turning point."""
    t, times, values = series.t, decay.times, decay.values
    k = times.size - 1
    gap = float(np.median(np.diff(times)[-5:]))
    before = float(abs(values[k] - values[k - 1]))
    after = series.values[(series.grid > times[k] + 0.1 * gap) & (series.grid < times[k] + 0.9 * gap)]
    still = max(2 * series.step + 4.5 * series.noise, 0.1 * before)
    left = float(t[-1] - times[k])
    if left > 0.8 * gap and k >= 3 and before > 4 * found.floor and np.abs(after - values[k]).max() <= still:
        why = "the last turning point from which it swings back; in the swing after it it comes to rest, and stays."
        return _index(t, times[k - 1]), why
    turned = Turning(-times[::-1], values[::-1], decay.gain[::-1])
    if left <= 1.2 * gap:
        if k < 4 or left < 0.2 * gap or series.turned().reach(turned).whole:
            return t.size - 1, ""
        return _stopped(series, turned)
    later = series.values[(series.grid > times[k] + gap) & (series.grid < times[k] + 3 * gap)]
    if k >= LEAST_BEFORE and before > 4 * found.floor and float(np.ptp(later)) > 0.25 * before:
        return _stopped(series, turned)
    why = "the last turning point that stands out of noise and rounding; after it the record is at rest or all but."
    return _index(t, times[k]), why


def _stopped(series: _Series, turned: Turning) -> tuple[int, str]:
    """Return the end of a free decay that a hand, a hit or a stop ends. turned: its turning points, backwards."""
    gap, swing = float(turned.times[1] - turned.times[0]), abs(float(turned.values[1] - turned.values[0]))
    last, turned_series = float(turned.times[0]), series.turned()
    touched = turned_series.reach(turned).share < TOUCHED and _moves(
        turned_series, last - MARGIN * gap, last, swing
    )
    at = -float(turned.times[1 if touched else 0])
    why = (
        "the last turning point that nothing has touched; what is after it does not continue the free decay."
    )
    return _index(series.t, at), why


def _index(t: np.ndarray, at: float) -> int:
    return int(np.searchsorted(t, at + 1e-12)) - 1


def _all_decays(t: np.ndarray, found: _Found, first: int, last: int) -> tuple[FreeDecay, ...]:
    """Return the decay from sample `first` to `last` and the others of the record, in their order in time."""
    decays = [FreeDecay(float(t[first]), float(t[last]))]
    least = OTHER * worth(found.turns, found.best)
    for a, b in found.stretches:
        begin, end = float(found.turns.times[a]), float(found.turns.times[b - 1])
        apart = (a, b) != found.best and (end <= t[first] or begin >= t[last])
        if apart and b - a >= 4 and worth(found.turns, (a, b)) >= least:
            decays.append(FreeDecay(begin, end))
    return tuple(sorted(decays, key=lambda decay: decay.start))
