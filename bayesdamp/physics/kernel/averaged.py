"""Compute amplitude and phase of motions of hundreds of cycles, from an oscillation that decays over fewer cycles.

To first order of the damping, amplitude and phase of a free decay follow averaged equations, in which time and the size
of the damping come as a product alone (N. N. Bogoliubov and Y. A. Mitropolsky, Asymptotic Methods in the Theory of
Non-linear Oscillations, 1961, chapter 1): damping that is M times larger does in a cycle what it did in M. So these
equations are solved as the equation of motion itself with the damping times M, over an M-th of the time, for any
damping and any restoring force: amplitudes are those of the record, the phase advances by an M-th of the record's. What
the next orders change is the difference to the ODE, solved over all cycles at one set of parameters and added near
there (defect correction: H. J. Stetter, Numer. Math. 29, 425 (1978)).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from bayesdamp.physics.kernel.solve import ALL, NONE, PARAMETERS, Motion, Solver

TURNS, REAL_TURNS = 2, 4
"""Cycles that are read for an amplitude and a phase: of the oscillation that is solved, a whole number of which goes
before the middle of a block, and of the ODE's."""
PHASES = 16
"""Points in a cycle at which they are read."""
BY_ODE = 1e-10
"""Error of a step of the ODE, as a share of the amplitude: a cycle is then right to 1e-8 of itself, or better."""
A_SEGMENT = 1000.0
"""Cycles that the ODE is solved over at once: what bounds its memory."""


def _window(turns: int) -> tuple[np.ndarray, np.ndarray]:
    """Return phases about the middle of `turns` cycles, (s,), and weights there that sum to 1.

    The weights are a power of Hann's window, which separates the midline, the frequency and its multiples from each
    other; the larger the power, the steeper the separation.
    """
    share = (np.arange(PHASES * turns) + 0.5) / (PHASES * turns) - 0.5
    weight = np.cos(np.pi * share) ** turns
    return 2 * np.pi * turns * share, weight / weight.sum()


OFFSETS, _WEIGHTS = _window(TURNS)
REAL_OFFSETS, _REAL_WEIGHTS = _window(REAL_TURNS)
NUMBERS = 3
"""Numbers of a block: amplitude, phase times the record's amplitude, √2 times the midline; white noise is equal in
all three."""


@dataclass(frozen=True)
class Track:
    """The times and phases against which a record's amplitude and phase are measured, in blocks (b,).

    slowness: M ≥ 1, cycles of the record for one that is solved. times, phases: (b, s) in s and rad, of the solved
    oscillation at `OFFSETS`; real_times, real_phases: the same of the record itself at `REAL_OFFSETS`. sizes: the
    record's amplitudes, (b,), in its unit, by which phases are multiplied.
    """

    slowness: float
    times: np.ndarray
    phases: np.ndarray
    real_times: np.ndarray
    real_phases: np.ndarray
    sizes: np.ndarray

    @cached_property
    def middles(self) -> np.ndarray:
        """Times of the blocks in the record, s, (b,)."""
        return self.real_times.mean(axis=1)


@dataclass(frozen=True)
class AveragedSolver(Solver):
    """A `Solver` of amplitudes and phases.

    Its t, (3b,), are the ends of the blocks in the time that is solved. Its values come in threes: a block's amplitude,
    its phase beyond the track's times the record's amplitude there, and √2 times its midline.

    Parameters are those of the record; knots, and the times of a `Motion`, are an M-th of the record's.
    defect: (3b,), what the ODE differs by, near where it was taken.
    """

    track: Track = field(kw_only=True)
    defect: np.ndarray | None = field(default=None, kw_only=True)

    @property
    def slowness(self) -> float:
        """Return the number of the record's cycles for each cycle that is solved."""
        return self.track.slowness

    def at(self, t: np.ndarray, quantity: str) -> Solver:
        """Return a solver of the equation of motion itself at times t of the record, (n,), in s."""
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
    ) -> Motion | None:
        """As `Solver.solve`; stop counts a block's numbers."""
        blocks = len(self.track.sizes) if stop is None else -(-stop // NUMBERS)
        if blocks not in self._readers:
            t, order = _sorted(self.track.times[:blocks])
            self._readers[blocks] = self._plain(t, self.knots), order
        inner, order = self._readers[blocks]
        p = np.array(p, float)
        p[: len(self.terms)] *= self.slowness
        if tangents == ALL:  # the blocks end a little before the last knot, and all knots have tangents
            none = np.zeros(self.knots.size)
            g, h = none if g is None else g, none if h is None else h
        motion = inner.solve(p, active, g, h, tangents, tolerance=tolerance)
        if motion is None:
            return None
        z, middle = _projected(motion.y, order, self.track.phases)
        if not np.all(np.abs(z) > 0):
            return None
        y = self._threes(np.abs(z), self._stretched(np.unwrap(np.angle(z))), middle)[:stop]
        if self.defect is not None:
            y = y + self.defect[:stop]
        slopes = motion.tangents
        if tangents:
            turned, middle = _projected(slopes, order, self.track.phases)
            relative = turned / z[:, None]
            slopes = np.empty((NUMBERS * z.size, relative.shape[1]))
            slopes[::NUMBERS] = np.abs(z)[:, None] * relative.real
            slopes[1::NUMBERS] = self.track.sizes[: z.size, None] * self._stretched(relative.imag)
            slopes[2::NUMBERS] = np.sqrt(2) * middle
            slopes = slopes[:stop]
            slopes[:, : len(self.terms)] *= self.slowness
        return Motion(y, slopes, motion.times, motion.states)

    def corrected(
        self, p: np.ndarray, active: np.ndarray, g: np.ndarray | None = None, h: np.ndarray | None = None
    ) -> AveragedSolver | None:
        """Return the solver with the defect at p, (k,), and deviations g and h; None where a motion escapes there."""
        defect = replace(self, defect=None).error(p, active, g, h)
        return None if defect is None else replace(self, defect=defect)

    def error(
        self, p: np.ndarray, active: np.ndarray, g: np.ndarray | None = None, h: np.ndarray | None = None
    ) -> np.ndarray | None:
        """Return the difference of the ODE's numbers from those of `solve`, (3b,); None where a motion escapes."""
        own, true = self.solve(p, active, g, h, tangents=NONE), self.by_ode(p, active, g, h)
        if own is None or true is None:
            return None
        z, middle = true
        size, phase, own_middle = own.y.reshape(-1, NUMBERS).T
        more = np.unwrap(np.angle(z * np.exp(-1j * phase / self.track.sizes)))
        return self._threes(np.abs(z) - size, more, middle - own_middle / np.sqrt(2))

    def by_ode(
        self, p: np.ndarray, active: np.ndarray, g: np.ndarray | None = None, h: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Return complex amplitudes and midlines, (b,) each, of the equation of motion itself over every cycle.

        None where it escapes.
        """
        t, order = _sorted(self.track.real_times)
        knots = self.knots * self.slowness
        none = np.zeros(knots.size)
        g, h = none if g is None else np.asarray(g, float), none if h is None else np.asarray(h, float)
        longest = A_SEGMENT * 2 * np.pi / self.frequency
        ends = [0.0]
        for a, b in pairwise(knots):
            ends += np.linspace(a, b, int(np.ceil((b - a) / longest)) + 1)[1:].tolist()
        places = np.searchsorted(t, ends)
        places[0], places[-1] = 0, t.size
        p, read = np.array(p, float), [np.empty(0)]
        for i in range(len(ends) - 1):
            begin, end = ends[i], ends[i + 1]
            span = np.array([0.0, end - begin])
            inside = t[places[i] : places[i + 1]] - begin
            plain = self._plain(inside if inside.size else span, span)
            both = np.array([begin, end])
            motion = plain.solve(
                p, active, np.interp(both, knots, g), np.interp(both, knots, h), NONE, tolerance=BY_ODE
            )
            if motion is None:
                return None
            if inside.size:
                read.append(motion.y)
            p[-2:] = motion.states[-1, :2]
        return _projected(np.concatenate(read), order, self.track.real_phases)

    def _stretched(self, phase: np.ndarray) -> np.ndarray:
        """Return the record's phases from the solved ones, (b, ...).

        The phase since the start is M times as large. The phase of the start itself, from a line through the first two
        blocks, stays as it is.
        """
        begun = 1.5 * phase[0] - 0.5 * phase[1] if len(phase) > 1 else phase[0]
        return self.slowness * phase - (self.slowness - 1) * begun

    def _threes(self, size: np.ndarray, phase: np.ndarray, middle: np.ndarray) -> np.ndarray:
        return np.column_stack([size, self.track.sizes[: size.size] * phase, np.sqrt(2) * middle]).ravel()

    @cached_property
    def _readers(self) -> dict[int, tuple[Solver, np.ndarray]]:
        """Solvers of the oscillation at the points of the first so many blocks, and their order in time."""
        return {}

    def _plain(self, t: np.ndarray, knots: np.ndarray) -> Solver:
        return Solver(
            self.terms, self.restoring, t, self.quantity, self.amplitude, self.frequency, self.epsilon, knots
        )  # fmt: skip


def _sorted(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sort times, (b, s), and return with them the place of each among the sorted ones, (b s,)."""
    order = np.argsort(times.ravel(), kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(order.size)
    return times.ravel()[order], place


def _projected(values: np.ndarray, order: np.ndarray, phases: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return complex amplitudes against phases (b, s), and midlines, (b, ...) each, of values (n, ...).

    The values are in rising order of time.
    """
    points = values[order].reshape(-1, phases.shape[1], int(np.prod(values.shape[1:])))
    blocks, weights = len(points), _WEIGHTS if phases.shape[1] == OFFSETS.size else _REAL_WEIGHTS
    turned = 2 * weights * np.exp(-1j * phases[:blocks])
    shape = (blocks, *values.shape[1:])
    # As products of real matrices, which are several times faster than one of a complex with a real one.
    real, imaginary = (np.matmul(part[:, None], points) for part in (np.real(turned), np.imag(turned)))
    return (real + 1j * imaginary).reshape(shape), (weights @ points).reshape(shape)
