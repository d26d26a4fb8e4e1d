"""The no-U-turn sampler, whitened at the mode, on the compiled kernel.

Its transition (M. D. Hoffman and A. Gelman, JMLR 15, 2014) runs between walls, with multinomial choice among the points
of a trajectory (M. Betancourt, arXiv:1701.02434, 2017, appendix A.3).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.coordinates.shear import shear_of
from bayesdamp.inference.coordinates.whitening import Whitening, whitening_of, whitening_under
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.likelihood import Likelihood, Line
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers._sampler import Sampler, Settings
from bayesdamp.inference.samplers._starts import Start, agreement, seeded_starts
from bayesdamp.types import OK, Posterior

DOUBLINGS = 7
"""A trajectory has at most 2⁷ steps."""
DIVERGED = 1000.0
"""Rise of the energy that ends a trajectory (conventional)."""
BOUNCES = 4
"""Bounces in one step, for each wall; a step that would take more ends outside, where it is refused."""


@dataclass(frozen=True)
class Whitened:
    """A log density in whitened coordinates u, (d,), and the force that moves proposals.

    Attributes
    ----------
    likelihood : Likelihood
        Whose posterior it is.
    at : Whitening
        Maps coordinates to scores.
    line : Line or None
        The motion's straight line that the force is taken from; None for the exact gradient.
    walls, offsets : ndarray, shapes (k, d) and (k,)
        walls @ u + offsets ≥ 0 inside.
    """

    likelihood: Likelihood
    at: Whitening
    line: Line | None
    walls: np.ndarray
    offsets: np.ndarray

    @classmethod
    def of(cls, mode: Mode, at: Whitening, exact: bool) -> Whitened:
        """Return the posterior of a mode's target; exact: whether the force is its gradient."""
        likelihood = mode.likelihood
        line = None if exact else likelihood.line(at.shear.scores(at.centre))
        reflected = likelihood.target.reflected
        return cls(likelihood, at, line, at.factor[reflected], at.centre[reflected])

    def height(self, u: np.ndarray) -> float:
        """Return the log density; −∞ where the motion escapes."""
        return self.likelihood.log_posterior(self.at.scores(u))

    def slope(self, u: np.ndarray) -> np.ndarray:
        """Return the force, (d,)."""
        at, shear = self.at, self.at.shear
        away = at.factor @ u
        if self.line is None:
            straight = at.centre + away
            pull = self.likelihood.gradient(shear.scores(straight))[1] @ shear.slope(straight)
        else:
            # A straight line stays one: straightened, the ridge is where it has it.
            level = shear.level(at.centre) + away
            along = self.likelihood.gradient_along(self.line, shear.noise.sheared(level))
            pull = along @ shear.noise.slope(level) - at.lacking @ away
        return pull @ at.factor


@dataclass(frozen=True)
class Point:
    """A point of a trajectory: position, momentum and force, (d,) each, and the log density."""

    u: np.ndarray
    p: np.ndarray
    slope: np.ndarray
    height: float

    @property
    def joint(self) -> float:
        """Log density of position and momentum."""
        return self.height - 0.5 * float(self.p @ self.p)


@dataclass
class _Tree:
    """A part of a trajectory: its ends in time, the point that is chosen of it, the log of the sum of its densities,
    the sum of its momenta, and whether it goes on."""

    first: Point
    last: Point
    chosen: Point
    weight: float
    momentum: np.ndarray
    goes_on: bool


class Chain:
    """A Markov chain in a space, with steps of a length."""

    def __init__(self, space: Whitened, step: float, rng: np.random.Generator) -> None:
        self.space, self.step, self.rng = space, step, rng

    def sampled(self, u: np.ndarray, height: float, count: int) -> tuple[np.ndarray, ...]:
        """Return positions (count, d), heights, divergences, steps and acceptance, (count,) each, from a start u, (d,),
        of this height on."""
        left = (
            np.empty((count, u.size)),
            np.empty(count),
            np.empty(count, bool),
            np.empty(count, int),
            np.empty(count),
        )
        at = Point(u, np.zeros(u.size), self.space.slope(u), height)
        for i in range(count):
            at, *rest = self.transition(at)
            for into, value in zip(left, (at.u, at.height, *rest), strict=True):
                into[i] = value
        return left

    def transition(self, at: Point) -> tuple[Point, bool, int, float]:
        """Return the next point, whether the trajectory diverged, its steps, and the mean acceptance."""
        at = Point(at.u, self.rng.standard_normal(at.u.size), at.slope, at.height)
        self._begun, self._steps, self._accepted, self._diverged = at.joint, 0, 0.0, False
        tree = _Tree(at, at, at, at.joint, at.p.copy(), True)
        for doubling in range(DOUBLINGS):
            ahead = bool(self.rng.random() < 0.5)
            new = self._built(tree.last if ahead else tree.first, 1 if ahead else -1, doubling)
            if not new.goes_on:
                break
            if np.log(self.rng.random()) < new.weight - tree.weight:
                tree.chosen = new.chosen
            tree = self._joined(tree, new, ahead, tree.chosen)
            if not tree.goes_on:
                break
        return tree.chosen, self._diverged, self._steps, self._accepted / max(self._steps, 1)

    def _built(self, end: Point, way: int, depth: int) -> _Tree:
        """Return 2^depth further points beyond an end of the trajectory; fewer where it does not go on."""
        if depth == 0:
            point = self._stepped(end, way)
            joint = point.joint if np.isfinite(point.height) else -np.inf
            self._steps += 1
            self._accepted += float(np.exp(min(0.0, joint - self._begun)))
            diverged = not joint > self._begun - DIVERGED
            self._diverged = self._diverged or diverged
            return _Tree(point, point, point, joint, point.p, not diverged)
        near = self._built(end, way, depth - 1)
        if not near.goes_on:
            return near
        far = self._built(near.last if way > 0 else near.first, way, depth - 1)
        if not far.goes_on:
            return far
        share = far.weight - np.logaddexp(near.weight, far.weight)
        chosen = far.chosen if np.log(self.rng.random()) < share else near.chosen
        return self._joined(near, far, way > 0, chosen)

    @staticmethod
    def _joined(tree: _Tree, new: _Tree, ahead: bool, chosen: Point) -> _Tree:
        """Return both parts as one; it goes on unless it, or the half of it about the join, turns round."""
        one, two = (tree, new) if ahead else (new, tree)
        momentum = one.momentum + two.momentum
        goes_on = (
            _apart(one.first, two.last, momentum)
            and _apart(one.first, two.first, one.momentum + two.first.p)
            and _apart(one.last, two.last, two.momentum + one.last.p)
        )
        return _Tree(
            one.first, two.last, chosen, float(np.logaddexp(one.weight, two.weight)), momentum, goes_on
        )

    def _stepped(self, at: Point, way: int) -> Point:
        """Return the point a leapfrog step ahead or back. The force need not be the density's gradient: each kick is a
        shear of the momenta, whatever it is."""
        size = way * self.step
        u, p = drift(at.u, at.p + 0.5 * size * at.slope, size, self.space.walls, self.space.offsets)
        if not np.all(np.isfinite(u)):
            return Point(u, p, at.slope, -np.inf)
        height = self.space.height(u)
        slope = self.space.slope(u) if np.isfinite(height) else at.slope
        return Point(u, p + 0.5 * size * slope, slope, height)


def _apart(first: Point, last: Point, momentum: np.ndarray) -> bool:
    """Whether both ends still move away from each other."""
    return float(first.p @ momentum) > 0 and float(last.p @ momentum) > 0


def drift(
    u: np.ndarray, p: np.ndarray, time: float, walls: np.ndarray, offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return position (d,) and momentum (d,) after `time` of straight flight within walls @ u + offsets ≥ 0.

    At a wall the momentum is mirrored: time can be run backwards and volume is kept, so that a leapfrog step made of it
    is as good as one without walls (Afshar and Domke, NeurIPS 28, 2015). time may be negative. The position is not a
    number after more than `BOUNCES` bounces for each wall.

    Parameters
    ----------
    walls, offsets
        Shapes (k, d) and (k,).
    """
    straight = u + time * p
    if np.all(walls @ straight + offsets >= 0.0):  # nothing in the way between two points inside
        return straight, p
    towards = 1.0 if time >= 0 else -1.0
    v, left = towards * p, abs(time)
    for _ in range(BOUNCES * len(walls) + 1):
        closing = -(walls @ v)
        reach = np.where(
            closing > 0, np.maximum(walls @ u + offsets, 0.0) / np.where(closing > 0, closing, 1.0), np.inf
        )
        first = int(np.argmin(reach)) if reach.size else 0
        if not reach.size or reach[first] >= left:
            return u + left * v, towards * v
        u = u + reach[first] * v
        left -= float(reach[first])
        normal = walls[first] / np.linalg.norm(walls[first])
        v = v - 2.0 * (normal @ v) * normal
    return np.full_like(u, np.nan), towards * v


STEP = 1.05
"""Step in whitened coordinates: a little more than π/3, so that four points of a circle span half a turn, behind which
a trajectory ends. A shorter step makes it twice as long for draws that are no better."""
POOR = 0.5
"""Mean acceptance below which the force is no good."""
DIVERGING = 0.002
"""And the share of divergences above which; a fifth of that from which the draws are not trusted."""
STEPS = (1.0, 0.5, 0.25, 0.125)
"""Shares of the usual step that the exact force is tried with."""
LONGEST = 3
"""Times the draws that were asked for, from which on none are added."""


def poor(found: Posterior) -> bool:
    """Whether steps or force were not good enough: refusals or divergences."""
    refused = float(np.mean(found.stats["acceptance_rate"])) < POOR
    return refused or float(np.mean(found.stats["diverging"])) > DIVERGING


@dataclass(frozen=True)
class Run:
    """The chains of one record, and what they left.

    left: positions (chain, warm-up and draw, d), heights, divergences, steps and acceptance, (chain, warm-up and draw).
    """

    at: Whitening
    exact: bool
    warmup: int
    begun: list[Start]
    chains: list[Chain]
    left: tuple[np.ndarray, ...]

    @property
    def draws(self) -> int:
        """How many of each chain are kept, without the warm-up."""
        return self.left[0].shape[1] - self.warmup

    def posterior(self, mode: Mode) -> Posterior:
        """Return the draws after the warm-up, with their diagnostics."""
        target = mode.likelihood.target
        u, height, diverging, steps, accept = (x[:, self.warmup :] for x in self.left)
        z = self.at.scores(u)
        values = target.values(z)
        summaries = {n: diagnostics.summarise(v) for n, v in values.items()}
        divergences = int(np.sum(diverging))
        outcome = diagnostics.verdict(summaries)
        if outcome == OK and divergences > 0.01 * diverging.size:
            outcome = f"{divergences} of {diverging.size} transitions diverged"
        draws = np.stack(list(values.values()), axis=-1)
        return Posterior(
            sampler=Nuts.name,
            names=target.names,
            draws=draws,
            log_likelihood=height - mode.likelihood.log_prior(z),
            stats={"diverging": diverging, "n_steps": steps, "acceptance_rate": accept},
            diagnostics={"exact_force": self.exact, "step": self.chains[0].step},
            outcome=outcome,
            summaries=summaries,
            starts=agreement(self.begun, draws),
            divergences=divergences,
            evaluations=int(np.sum(steps)),
        )

    def longer(self, count: int) -> Run:
        """Return the same with count more draws of each chain, from where it ended."""
        more = [
            chain.sampled(u[-1], float(height[-1]), count)
            for chain, u, height in zip(self.chains, *self.left[:2], strict=True)
        ]
        whole = tuple(
            np.concatenate([x, np.stack(y)], axis=1)
            for x, y in zip(self.left, zip(*more, strict=True), strict=True)
        )
        return replace(self, left=whole)


class MixtureChain(Chain):
    """A chain in a posterior that is a mixture over hyperparameters of deviations.

    A combination of these is drawn given the position, then a position given the combination (Gibbs sampling). One
    component may be many times narrower than another, so that no step suits both.

    Attributes
    ----------
    mode : Mode
        The posterior's.
    whole : Whitened
        The coordinates of positions that the chain leaves.
    given : dict of int to Whitened
        The posterior given a combination, in coordinates of its own, as far as it was asked for; chains share it.
    """

    def __init__(
        self, mode: Mode, whole: Whitened, given: dict[int, Whitened], step: float, rng: np.random.Generator
    ) -> None:
        super().__init__(whole, step, rng)
        self.mode, self.whole, self.given = mode, whole, given

    def under(self, combination: int) -> Whitened:
        """Return the posterior given a combination."""
        if combination not in self.given:
            at = whitening_under(self.mode, combination, self.whole.at.shear)
            held = replace(self.mode, likelihood=self.mode.likelihood.under(combination))
            self.given[combination] = Whitened.of(held, at, self.whole.line is None)
        return self.given[combination]

    def sampled(self, u: np.ndarray, height: float, count: int) -> tuple[np.ndarray, ...]:
        """Return what `Chain.sampled` does; positions and heights are those of the whole mixture."""
        likelihood, left = self.mode.likelihood, []
        assert likelihood.target.deviation is not None
        z = self.whole.at.scores(u)
        residual, prior = likelihood.residual(z), float(likelihood.log_prior(z))
        for _ in range(count):
            self.space = self.under(likelihood.target.deviation.combination_given(residual, self.rng))
            u = self.space.at.whitened(z[None])[0]
            height = prior + self.space.likelihood.log_noise(residual, z)
            at, *rest = self.transition(Point(u, u, self.space.slope(u), height))
            z = self.space.at.scores(at.u)
            residual, prior = likelihood.residual(z), float(likelihood.log_prior(z))
            height = prior + likelihood.log_noise(residual, z)
            left.append((self.whole.at.whitened(z[None])[0], height, *rest))
        return tuple(map(np.array, zip(*left, strict=True)))


class Nuts(Sampler):
    """Hoffman and Gelman's NUTS (JMLR 15, 2014) in whitened coordinates that end where a damping is zero.

    Energies, which decide on acceptance, are exact. The force that moves a proposal may be any function of
    the position (leapfrog steps stay reversible and keep volume), so it is that of the linearised
    trajectory, which costs no tangents. With the whole curvature known the step is too. Draws that are
    too few are added to; where that does not help, or proposals are refused, they are taken again with a curved
    ridge straightened, with shorter steps, and with the exact gradient.
    """

    name = "nuts"

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Chains from the mode's neighbourhood, longer or again with other steps where they are not good enough."""
        at = whitening_of(target, mode)
        run, found = self._enough(mode, settings, self.attempt(mode, at, settings, not at.good))
        if found.outcome != OK or poor(found):
            ridge = shear_of(target, mode)
            if ridge is not None:
                at = whitening_of(target, mode, ridge)
                run, found = self._enough(mode, settings, self.attempt(mode, at, settings, not at.good))
        # Shorter steps help the cheap force too where the posterior has edges; only then is the force itself doubted.
        others = [(True, share) for share in STEPS]
        for exact, shorter in others[1:] if run.exact else [(False, 0.5), *others]:
            if not poor(found):
                break
            again = self.attempt(mode, run.at, settings, exact, shorter)
            run, found = self._enough(mode, settings, again)
        return found

    def attempt(
        self,
        mode: Mode,
        at: Whitening,
        settings: Settings,
        exact: bool = False,
        shorter: float = 1.0,
    ) -> Run:
        """Return as many draws as are asked for; shorter: share of the usual step."""
        target = mode.likelihood.target
        starts, heights, begun = seeded_starts(target, mode, at, settings.chains, settings)
        space = Whitened.of(mode, at, exact)
        warmup = settings.warmup_of(mode)
        count = warmup + settings.draws
        step, given = shorter * STEP, dict[int, Whitened]()
        chains = [
            Chain(space, step, rng)
            if target.deviation is None
            else MixtureChain(mode, space, given, step, rng)
            for rng in (np.random.default_rng([settings.seed, i]) for i in range(settings.chains))
        ]
        left = [
            chain.sampled(u, float(height), count)
            for chain, u, height in zip(chains, starts, heights, strict=True)
        ]
        return Run(at, exact, warmup, begun, chains, tuple(map(np.stack, zip(*left, strict=True))))

    def _enough(self, mode: Mode, settings: Settings, run: Run) -> tuple[Run, Posterior]:
        """Return the run with draws added while they are too few and might suffice, and its posterior."""
        found, count = run.posterior(mode), run.left[0].shape[1]
        most = LONGEST * settings.draws if settings.grows else settings.draws
        while found.outcome != OK and not poor(found) and run.draws < most:
            run = run.longer(count)
            found = run.posterior(mode)
        return run, found


PLUGIN = Nuts()
