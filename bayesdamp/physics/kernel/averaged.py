"""Compute amplitudes and phases of decays over hundreds of cycles, from an oscillation that decays over fewer cycles.

To first order in the damping, amplitude and phase of a free decay obey averaged equations that depend only on the
product of time and damping (N. N. Bogoliubov and Y. A. Mitropolsky, Asymptotic Methods in the Theory of Non-linear
Oscillations, 1961, chapter 1). Therefore M times the damping has the same effect in one cycle as the damping has in M
cycles. We integrate the equation of motion with M times the damping over 1/M of the duration: this is the compressed
oscillation. Its amplitudes are those of the record, and its phase advances by 1/M of the record's phase. This works for
any damping and restoring force. The effect of higher orders (the defect) is the difference to the actual equation of
motion. It is computed once, by integrating the actual equation over all cycles, and is then added to the results for
similar parameters (defect correction: H. J. Stetter, Numer. Math. 29, 425 (1978)).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from bayesdamp.physics.kernel.solve import ALL, NONE, PARAMETERS, TOLERANCE, Motion, Solver

TURNS, REAL_TURNS = 2, 4
"""Number of cycles over which one amplitude and phase are measured: `TURNS` in the compressed oscillation, which has M
times the damping and lasts 1/M of the time, and `REAL_TURNS` in the actual one."""
PHASES = 16
"""Number of times per cycle at which the oscillation is evaluated to measure its amplitude and phase (conventional)."""
ODE_TOLERANCE = 1e-10
"""Largest error of a step when the actual equation of motion is integrated, relative to the amplitude. Over a cycle the
error is then 1e-8 of the amplitude, or less (measured)."""
CYCLES_PER_SEGMENT = 1000.0
"""Greatest number of cycles over which the actual equation of motion is integrated at once; this limits the memory
(conventional)."""


def _window(turns: int) -> tuple[np.ndarray, np.ndarray]:
    """Return phases in rad and weights, (s,) each, of the points from which one amplitude and phase are measured.

    The phases extend over `turns` cycles, with 0 in the middle. The weights are a power of a cosine (for 2 cycles a
    Hann window), and their sum is 1. They separate the midline, the fundamental and the harmonics of the oscillation; a
    larger power separates these more sharply.
    """
    share = (np.arange(PHASES * turns) + 0.5) / (PHASES * turns) - 0.5
    weight = np.cos(np.pi * share) ** turns
    return 2 * np.pi * turns * share, weight / weight.sum()


OFFSETS, _WEIGHTS = _window(TURNS)
REAL_OFFSETS, _REAL_WEIGHTS = _window(REAL_TURNS)
"""Phases in rad, relative to the middle of a group of cycles, at which the oscillation is evaluated to measure one
amplitude and phase. `OFFSETS` is for the compressed oscillation, which has M times the damping and 1/M of the cycles;
`REAL_OFFSETS` is for the actual one. `_WEIGHTS` and `_REAL_WEIGHTS` are the weights of these points."""
NUMBERS = 3
"""Number of values for each block (group of consecutive cycles): amplitude, phase and midline."""


@dataclass(frozen=True)
class Track:
    """Times and reference phases at which the amplitudes and phases of b blocks of cycles are measured.

    A block is a group of consecutive cycles with one amplitude and phase. The compressed oscillation has M times the
    damping of the actual one, and passes through the same amplitudes in 1/M of the cycles.

    Attributes
    ----------
    slowness
        M ≥ 1, the number of the record's cycles for each cycle of the compressed oscillation.
    times, phases
        Times in s and phases in rad of the s points of each block in the compressed oscillation, (b, s). The phases of
        a block are `OFFSETS` about the phase of its middle.
    real_times, real_phases
        The same for the actual oscillation, with `REAL_OFFSETS`.
    weights
        Factors of the amplitudes and of the midlines, (b, 2).
    whitening
        Lower triangular matrix by which the phases are multiplied, (b, b). With it and `weights` all values of the
        blocks have independent noise of the same variance.
    """

    slowness: float
    times: np.ndarray
    phases: np.ndarray
    real_times: np.ndarray
    real_phases: np.ndarray
    weights: np.ndarray
    whitening: np.ndarray

    @cached_property
    def middles(self) -> np.ndarray:
        """Return the middle times of the b blocks (groups of consecutive cycles) in the record, in s, (b,)."""
        return self.real_times.mean(axis=1)

    def combine(self, size: np.ndarray, phase: np.ndarray, midline: np.ndarray) -> np.ndarray:
        """Scale amplitudes, phases and midlines of the first c blocks so that their noise is independent and equal.

        A block is a group of consecutive cycles. size, phase, midline: amplitudes, phases (rad) and midlines, (c, ...)
        each. Amplitudes and midlines are multiplied by the factors `weights`, phases by the matrix `whitening`. Return
        one array, (3c, ...), with amplitude, phase and midline of the first block, then of the second, and so on.
        """
        count = len(size)
        one, other = self.weights[:count].T.reshape(2, count, *[1] * (size.ndim - 1))
        white = np.tensordot(self.whitening[:count, :count], phase, axes=1)
        return np.stack([one * size, white, other * midline], axis=1).reshape(-1, *size.shape[1:])

    def separate(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return amplitudes, phases (rad) and midlines, (b,) each, of b blocks of cycles from their scaled values y.

        This inverts `combine`. y, (3b,): amplitude, phase and midline of each block in turn, multiplied by `weights`
        and `whitening`. Amplitudes and midlines are in the unit of the record; the phases are relative to the reference
        phases.
        """
        size, white, midline = y.reshape(-1, NUMBERS).T
        return size / self.weights[:, 0], np.linalg.solve(self.whitening, white), midline / self.weights[:, 1]


@dataclass(frozen=True)
class AveragedSolver(Solver):
    """A `Solver` that returns amplitudes and phases of b blocks (groups of consecutive cycles) instead of samples.

    It integrates the compressed oscillation, which has M times the damping and lasts 1/M of the time. Its values,
    (3b,), are three for each block: the amplitude, the phase relative to the reference phase in `track`, and the
    midline, multiplied by the factors in `track`. t, (3b,): for each value, the end of its block in compressed time
    (1/M of the record's time). Parameters are those of the record. The knots, and the times of a `Motion`, are in
    compressed time.

    track: times and phases of the blocks. defect: values for the actual equation of motion minus those for the
    compressed oscillation, (3b,). They are added to the values, and are valid near the parameters at which they were
    computed. None for 0.
    """

    track: Track = field(kw_only=True)
    defect: np.ndarray | None = field(default=None, kw_only=True)

    @property
    def slowness(self) -> float:
        """Return M, the number of cycles of the record for each cycle of the compressed oscillation.

        The compressed oscillation is the one that is integrated. It has M times the damping of the record in 1/M of the
        time.
        """
        return self.track.slowness

    def at(self, t: np.ndarray, quantity: str) -> Solver:
        """Return a solver that integrates the actual equation of motion, to compute a quantity at times t, (n,).

        t: times of the record in s. quantity: "angle", "velocity" or "acceleration".
        """
        return replace(self._plain(t, self.knots * self.slowness), quantity=quantity)

    def solve(
        self,
        p: np.ndarray,
        active: np.ndarray,
        g: np.ndarray | None = None,
        h: np.ndarray | None = None,
        tangents: int = PARAMETERS,
        stop: int | None = None,
        tolerance: float | None = None,
        epsilon: float | None = None,
    ) -> Motion | None:
        """Return the values of the blocks, and their derivatives, in a `Motion`; None if the trajectory diverges.

        The values are amplitude, phase and midline of each block (group of consecutive cycles) in turn, combined by
        `Track.combine` to values with independent, equal noise, plus `defect`; the derivatives are those without
        `defect`. The arguments are those of `Solver.solve`, but `stop` is the number of values to return (three for
        each block; None for all). The times and states in the result belong to the compressed oscillation, which has M
        times the damping in 1/M of the time. None is also returned if an amplitude is zero, or if the trajectory needs
        too many steps.
        """
        blocks = len(self.track.weights) if stop is None else -(-stop // NUMBERS)
        if blocks not in self._solvers:
            t, order = _sort_times(self.track.times[:blocks])
            self._solvers[blocks] = self._plain(t, self.knots), order
        inner, order = self._solvers[blocks]
        p = np.array(p, float)
        p[: len(self.terms)] *= self.slowness
        # Without g and h, `Solver.solve` could replace the knots by two; derivatives by g and h need all.
        if tangents == ALL:
            none = np.zeros(self.knots.size)
            g, h = none if g is None else g, none if h is None else h
        # The phases, with their errors, are multiplied by M below.
        tolerance = (tolerance or TOLERANCE) / self.slowness
        motion = inner.solve(p, active, g, h, tangents, tolerance=tolerance, epsilon=epsilon)
        if motion is None:
            return None
        z, middle = _demodulate(motion.y, order, self.track.phases)
        if not np.all(np.abs(z) > 0):
            return None
        y = self.track.combine(np.abs(z), self._to_record_phase(np.unwrap(np.angle(z))), middle)[:stop]
        if self.defect is not None:
            y = y + self.defect[:stop]
        slopes = motion.tangents
        if tangents:
            complex_slopes, middle = _demodulate(slopes, order, self.track.phases)
            relative = complex_slopes / z[:, None]
            sizes = np.abs(z)[:, None] * relative.real
            slopes = self.track.combine(sizes, self._to_record_phase(relative.imag), middle)[:stop]
            slopes[:, : len(self.terms)] *= self.slowness
        return Motion(y, slopes, motion.times, motion.states)

    def with_defect(
        self, p: np.ndarray, active: np.ndarray, g: np.ndarray | None = None, h: np.ndarray | None = None
    ) -> AveragedSolver | None:
        """Return a copy of this solver with the defect at parameters p, (k,), in place of its own; None if undefined.

        The defect is the result for the actual equation of motion minus that for the compressed oscillation, which has
        M times the damping in 1/M of the time. It is undefined if a trajectory diverges. active: which damping terms
        are on. g, h: at the knots; the damping force is multiplied by 1 + g, the restoring force by 1 + 2h; None for 0.
        """
        defect = replace(self, defect=None).defect_at(p, active, g, h)
        return None if defect is None else replace(self, defect=defect)

    def defect_at(
        self, p: np.ndarray, active: np.ndarray, g: np.ndarray | None = None, h: np.ndarray | None = None
    ) -> np.ndarray | None:
        """Return the values for the actual equation of motion minus those that `solve` returns, (3b,).

        The values are amplitude, phase and midline of each of b blocks of cycles, as in `solve`, whose values are those
        of the compressed oscillation plus the present `defect`. p: parameters at which both are computed, in the order
        of `names`, (k,). active: which damping terms are on. g, h: at the knots; the damping force is multiplied by 1 +
        g, the restoring force by 1 + 2h; None for 0. Return None if a trajectory diverges, or if an amplitude of the
        compressed oscillation is zero.
        """
        own, true = self.solve(p, active, g, h, tangents=NONE), self.integrate_all_cycles(p, active, g, h)
        if own is None or true is None:
            return None
        z, middle = true
        size, phase, own_middle = self.track.separate(own.y)
        more = np.unwrap(np.angle(z * np.exp(-1j * phase)))
        return self.track.combine(np.abs(z) - size, more, middle - own_middle)

    def integrate_all_cycles(
        self, p: np.ndarray, active: np.ndarray, g: np.ndarray | None = None, h: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Integrate the actual equation over all cycles; return complex amplitudes and midlines of blocks, (b,) each.

        A block is a group of consecutive cycles. The phase of each complex amplitude is relative to the reference
        phases `real_phases` in `track`. p: parameters in the order of `names`, (k,). active: which damping terms are
        on. g, h: at the knots; the damping force is multiplied by 1 + g, the restoring force by 1 + 2h; None for 0.
        Return None if the trajectory diverges. The duration is integrated in segments, each of which starts from the
        end of the one before.
        """
        t, order = _sort_times(self.track.real_times)
        knots = self.knots * self.slowness
        none = np.zeros(knots.size)
        g, h = none if g is None else np.asarray(g, float), none if h is None else np.asarray(h, float)
        longest = CYCLES_PER_SEGMENT * 2 * np.pi / self.frequency
        ends = [0.0]
        for a, b in pairwise(knots):
            ends += np.linspace(a, b, int(np.ceil((b - a) / longest)) + 1)[1:].tolist()
        places = np.searchsorted(t, ends)
        places[0], places[-1] = 0, t.size
        p, read = np.array(p, float), [np.empty(0)]
        for i, (begin, end) in enumerate(pairwise(ends)):
            span = np.array([0.0, end - begin])
            inside = t[places[i] : places[i + 1]] - begin
            plain = self._plain(inside if inside.size else span, span)
            both = np.array([begin, end])
            motion = plain.solve(
                p, active, np.interp(both, knots, g), np.interp(both, knots, h), NONE, tolerance=ODE_TOLERANCE
            )
            if motion is None:
                return None
            if inside.size:
                read.append(motion.y)
            p[-2:] = motion.states[-1, :2]
        return _demodulate(np.concatenate(read), order, self.track.real_phases)

    def _to_record_phase(self, phase: np.ndarray) -> np.ndarray:
        """Convert phases of the compressed oscillation, (b, ...), to phases of the record.

        The compressed oscillation has 1/M of the record's cycles, so the phase advance since the start is multiplied by
        M. The phase at the start, extrapolated linearly from the first two blocks, stays the same.
        """
        begun = 1.5 * phase[0] - 0.5 * phase[1] if len(phase) > 1 else phase[0]
        return self.slowness * phase - (self.slowness - 1) * begun

    @cached_property
    def _solvers(self) -> dict[int, tuple[Solver, np.ndarray]]:
        """Return a cache of solvers of the compressed oscillation, by number of blocks; it is empty at first.

        A block is a group of consecutive cycles. For each number b, `solve` stores the solver for the points of the
        first b blocks, and the index of each point in the order of time.
        """
        return {}

    def _plain(self, t: np.ndarray, knots: np.ndarray) -> Solver:
        return Solver(
            self.terms, self.restoring, t, self.quantity, self.amplitude, self.frequency, self.epsilon, knots
        )  # fmt: skip


def _sort_times(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sort the times of the s points of each of b blocks of cycles, (b, s); the blocks may overlap in time.

    Return the times in rising order, (b·s,), and for each original time its index in this order, (b·s,).
    """
    order = np.argsort(times.ravel(), kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(order.size)
    return times.ravel()[order], place


def _demodulate(values: np.ndarray, order: np.ndarray, phases: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the complex amplitude, relative to reference phases, and the midline of each block, (b, ...) each.

    A block is a group of consecutive cycles, evaluated at s points. values: values of the oscillation in the order of
    time, (n, ...). order: for each point of each block, its index in `values`, (b·s,). phases: reference phases of the
    points in rad, (b or more, s).
    """
    points = values[order].reshape(-1, phases.shape[1], int(np.prod(values.shape[1:])))
    blocks, weights = len(points), _WEIGHTS if phases.shape[1] == OFFSETS.size else _REAL_WEIGHTS
    carrier = 2 * weights * np.exp(-1j * phases[:blocks])
    shape = (blocks, *values.shape[1:])
    # Two products of real matrices are several times faster than one of a complex with a real matrix.
    real, imaginary = (np.matmul(part[:, None], points) for part in (np.real(carrier), np.imag(carrier)))
    return (real + 1j * imaginary).reshape(shape), (weights @ points).reshape(shape)
