"""All candidates on one record, weighed under laws that hold exactly and approximately."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Self

import numpy as np

from bayesdamp.inference.deviation.averaged import Averaging
from bayesdamp.inference.deviation.candidate import (
    Candidate,
    Linearised,
    exact,
    first_values,
    parameters_of,
    refit,
    relinearised,
    searched,
    starts_of,
)
from bayesdamp.inference.deviation.data import Data
from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of, knots_of
from bayesdamp.inference.deviation.gaussian.linear import Linear, Weighed, weigh
from bayesdamp.inference.deviation.gaussian.noise import inflation
from bayesdamp.inference.deviation.gaussian.tempered import Sampled
from bayesdamp.inference.deviation.least_squares import Fit
from bayesdamp.inference.deviation.sample_noise import (
    AUTOMATIC,
    GAUSSIAN,
    SampleNoise,
    adapted,
    predictable,
)
from bayesdamp.machine.threads import at_once
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.physics.kernel.averaged import AveragedSolver
from bayesdamp.physics.kernel.build import source_of
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import Prior
from bayesdamp.types import Friction, Reference, Refusal

SHARES = (0.05, 0.02, 0.01, 0.005, 0.002)
"""ε as shares of the peak velocity that are tried where nobody gave it, its logarithm uniform beforehand."""
BETWEEN, TOLD = 4, 1.0
"""Widths between these that are tried at most, and nats by which the likeliest must be ahead of a neighbour for it."""
LEAD = 3.0
"""Nats by which another ε must be ahead of the usual one."""
Known = Mapping[str, float] | Callable[[str], Mapping[str, float]]
START = ("theta0", "omega0")
ROUNDS = 2
"""How often averaged motions are set right by the ODE, and the fits that this is done at found again."""
REACH = 30.0
"""Nats behind the best, with all dampings under both, from which a restoring law is out of the question."""


@dataclass(frozen=True)
class Result:
    """One candidate weighed: log evidence (nats) under exact laws and under approximate ones."""

    candidate: Candidate
    solver: Solver
    fit: Fit
    exact: Linear
    exact_weighed: Weighed
    exact_variance: float
    about: Linearised | None = None
    weighed: Weighed | None = None
    sampled: Sampled | None = None

    @classmethod
    def of(
        cls,
        candidate: Candidate,
        solver: Solver,
        found: Fit,
        about: Linearised | None,
        variances: tuple[float, float],
        samples: float,
    ) -> Self:
        """Weigh a fit.

        about: the candidate with deviations; variances: of the noise under exact laws, and of that which counts;
        samples: how many independent ones the record stands for.
        """
        own, variance = variances
        linear, over = exact(found), None
        if about is not None:
            grid = grid_of(solver.knots.size, absorbed=found.parameters.absorbs)
            over = weigh(about.model, grid, variance, samples)
        plain = weigh(linear, grid_of(0, exact=True), own, samples)
        return cls(candidate, solver, found, linear, plain, own, about, over)

    @property
    def log_evidence(self) -> float:
        """Under the laws that are asked for, in nats: of the motions where they were sampled, else of the linear
        model."""
        if self.sampled is not None and self.sampled.trusted:
            return self.sampled.log_evidence
        return (self.exact_weighed if self.weighed is None else self.weighed).log_evidence

    @property
    def deviations(self) -> tuple[np.ndarray, np.ndarray] | tuple[None, None]:
        """Relative deviations of damping and frequency at the knots, at the mode; None where laws hold exactly."""
        if self.about is None:
            return None, None
        g, h = np.split(self.about.u[self.fit.z.size :], 2)
        return np.expm1(g), h

    @property
    def motion(self) -> Motion:
        """The motion that the record's weights are taken along."""
        return self.fit.motion if self.about is None else self.about.motion


@dataclass(frozen=True)
class Weighing:
    """Every candidate on one record. variance: of the noise that counts, κ times that of what is left; frictions:
    widths of friction's turning over and how probable they are, none where it is known or there is no friction;
    exponents: quantiles of a power law's exponent, none where it was not asked for; averaging: of a record that is
    taken as amplitudes and phases, how far these are from the ODE's; noise: of the samples."""

    data: Data
    reference: Reference
    epsilon: float
    frictions: tuple[Friction, ...]
    solvers: Mapping[str, Solver]
    results: tuple[Result, ...]
    variance: float
    inflation: float
    refused: Mapping[Candidate, str] = field(default_factory=dict)
    forms: tuple[Result, ...] = ()
    exponents: tuple[float, ...] = ()
    noise_known: bool = False
    averaging: Averaging | None = None
    noise: SampleNoise = field(default_factory=SampleNoise)
    epsilon_known: bool = False

    @property
    def samples(self) -> float:
        """How many independent samples the record stands for."""
        return self.data.y.size / self.inflation


def weigh_all(
    data: Data,
    candidates: Iterable[Candidate],
    *,
    known: Known | None = None,
    priors: Mapping[str, Prior] | None = None,
    reference: Reference | None = None,
    approximate: bool = True,
    noises: Sequence[str] = AUTOMATIC,
) -> Weighing:
    """Fit and weigh candidates; those under one law begin with the sum of all terms.

    known: values of parameters, `noise_sd` among them, or a function of a law's name that gives them; priors: by
    parameter; approximate: whether deviations from the laws are weighed too; noises: the noise models to choose from.
    """
    priors = dict(priors or {})
    known_under = partial(_known_under, data=data, known=known, priors=priors)
    given_candidates = list(candidates)
    unsolved = {c: why for c in given_candidates if (why := _why_unsolved(c))}
    candidates = [c for c in given_candidates if c not in unsolved]
    if not candidates:
        raise Refusal(next(iter(unsolved.values())))
    reference = reference or Reference(float(f"{data.amplitude:.2g}"), float(f"{data.frequency:.2g}"))
    terms = tuple(dict.fromkeys(t for c in candidates for t in c.damping))
    given = known_under(candidates[0].restoring).get("epsilon")
    epsilon = reference.friction_width if given is None else given
    laws = list(dict.fromkeys(c.restoring for c in candidates))
    knots = knots_of(data.end, data.cycles)
    solvers = {law: data.solver(terms, law, epsilon, knots) for law in laws}
    refused: dict[Candidate, str] = dict(unsolved)
    fits: dict[Candidate, Fit] = {}

    given_to = {law: _given(solvers[law], data, reference, priors, known_under(law)) for law in laws}

    def seek(c: Candidate, near: Fit | None) -> None:
        solver, of_law = solvers[c.restoring], {**given_to[c.restoring], **known_under(c.restoring)}
        start = first_values(c, data, of_law)
        parameters = parameters_of(c, solver, data, reference, priors, of_law)
        found, each = None, starts_of(c, parameters)
        if near is not None:
            coefficients = {TERMS.get(t).parameter for t in c.damping}
            begun = near.parameters.named(near.z) | {k: v for k, v in start.items() if k in coefficients}
            found = searched(c, solver, data, parameters, [begun | one for one in each], windows=False)
        if found is None:
            found = searched(c, solver, data, parameters, [start | one for one in each], windows=True)
        if found is None:
            refused[c] = "no motion under it stays in phase with the record"
        else:
            fits[c] = found

    plain = tuple(t for t in terms if not TERMS.get(t).inferred)

    def seek_whole(law: str) -> None:
        if plain and plain != terms:
            seek(Candidate(plain, law), None)
        seek(Candidate(terms, law), fits.get(Candidate(plain, law)))

    for solver in solvers.values():
        assert solver.kernel  # compiled before several threads ask for it
    at_once(seek_whole, laws)
    for _ in range(ROUNDS if data.averaged is not None else 0):
        _corrected(solvers, fits)
        _refitted(data, solvers, fits)
    frictions = [] if given is not None else _frictions(data, solvers, fits, reference.peak_velocity)
    if frictions:
        density = np.array([f.weight for f in frictions]) / _cells(np.log([f.epsilon for f in frictions]))
        first, usual = int(np.argmax(density)), int(np.argmin([abs(f.epsilon - epsilon) for f in frictions]))
        if np.log(density[first] / max(density[usual], 1e-300)) > LEAD:
            epsilon = frictions[first].epsilon
            for law in laws:
                solvers[law] = replace(solvers[law], epsilon=epsilon)
            _refitted(data, solvers, fits)
    every = [Candidate(terms, law) for law in laws]
    every = [c if c in fits else Candidate(plain, c.restoring) for c in every]
    whole = [c for c in every if c in fits]
    wholes = _about(whole, solvers, data, fits)
    if not wholes:
        raise Refusal("no motion under any of the laws stays in phase with the record")
    stated = known_under(laws[0]).get("noise_sd")
    law = min(wholes, key=lambda name: wholes[name][1])
    other = adapted(noises, data, solvers[law], wholes[law][0], known_under(law), priors, approximate)
    if other is not None and other.noise.name != GAUSSIAN:
        data = other.data
        _refitted(data, solvers, fits)
        wholes = _about(whole, solvers, data, fits)
        at = wholes[law][0]
        kappa = inflation(data.t, at.left, data.frequency, at.u.size, other.variance)
        variance = kappa * other.variance
        stated = float(np.sqrt(other.variance))
    elif stated is None:
        variance, kappa = _noise(data, wholes, approximate)
        if other is not None and other.variance > variance:
            variance, kappa = other.variance, kappa * other.variance / variance
    else:
        variance, kappa = data.least_variance + stated**2 / data.thinned, 1.0
    noise = variance, kappa
    logs = {}
    for name, (at, _) in wholes.items():
        grid = grid_of(knots.size, coarse=True, absorbed=at.parameters.absorbs)
        logs[name] = weigh(at.model, grid, variance, data.y.size / kappa).log_evidence
    kept = {name for name, log in logs.items() if log > max(logs.values()) - REACH}
    asked: list[Candidate] = []
    for c in candidates:
        if c.restoring not in kept:
            refused.setdefault(c, "its restoring law is out of the question")
            continue
        asked.append(c)

    def weighed(c: Candidate) -> Result | None:
        if c not in fits:
            seek(c, fits.get(Candidate(terms, c.restoring), fits.get(Candidate(plain, c.restoring))))
        if c not in fits:
            return None
        return result_of(c, solvers[c.restoring], fits[c], data, noise, approximate, stated is not None)

    results = [r for r in at_once(weighed, asked) if r is not None]
    # In an order that does not depend on which core was first.
    order = dict.fromkeys([*every, *(Candidate(terms, law) for law in laws), *given_candidates])
    refused = {c: refused[c] for c in order if c in refused}
    return Weighing(
        data, reference, epsilon, tuple(frictions), solvers, tuple(results), variance, kappa, refused,
        noise_known=stated is not None, noise=SampleNoise() if other is None else other.noise,
        epsilon_known=given is not None,
    )  # fmt: skip


def _about(
    whole: Sequence[Candidate], solvers: Mapping[str, Solver], data: Data, fits: Mapping[Candidate, Fit]
) -> dict[str, tuple[Linearised, float]]:
    """The sums of all terms by law, about their modes, with the variance of what each leaves."""
    every = at_once(lambda c: relinearised(c, solvers[c.restoring], data, fits[c], None), whole)
    return {c.restoring: at for c, at in zip(whole, every, strict=True) if at is not None}


def _known_under(
    law: str, data: Data, known: Known | None, priors: Mapping[str, Prior]
) -> Mapping[str, float]:
    """Return what is known of a law's parameters.

    Velocities and accelerations do not depend on where the law's zero is: it is put at 0, where terms that depend on
    the position have theirs.
    """
    stated = known(law) if callable(known) else known or {}
    shift = LAWS.get(law).shift
    if shift and data.quantity != "angle" and shift not in priors:
        return {shift: 0.0, **stated}
    return stated


def _why_unsolved(candidate: Candidate) -> str:
    """Return why a user's own term or law cannot be compiled, "" where the candidate can be solved."""
    if LAWS.ships(candidate.restoring) and all(map(TERMS.ships, candidate.damping)):
        return ""
    try:
        source_of(candidate.damping, (candidate.restoring,))
    except Refusal as refusal:
        return str(refusal)
    return ""


def _given(
    solver: Solver, data: Data, reference: Reference, priors: Mapping[str, Prior], known: Mapping[str, float]
) -> dict[str, float]:
    """What terms are given under a law: where the motion comes to rest is that of a viscous fit."""
    at = data.rest
    if "rest" in solver.further:
        c, viscous = Candidate(("viscous",), solver.restoring), replace(solver, terms=("viscous",))
        parameters = parameters_of(c, viscous, data, reference, priors, known)
        found = searched(c, viscous, data, parameters, [first_values(c, data, known)], windows=True)
        if found is not None:
            law = found.parameters.values(found.z)[viscous.law_places]
            at = data.rest_under(solver.restoring, law)
    return reference.scales(at)


def result_of(
    c: Candidate,
    solver: Solver,
    found: Fit,
    data: Data,
    noise: tuple[float, float],
    approximate: bool,
    stated: bool,
) -> Result:
    """A candidate's fit, weighed. noise: the variance that counts, and the inflation in it; stated: it is known, and
    not read from the record, so that it counts under exact laws too."""
    variance, kappa = noise
    own = data.least_variance + kappa * found.squares / max(data.y.size - found.z.size, 1)
    about = relinearised(c, solver, data, found, variance) if approximate else None
    variances = variance if stated else own, variance
    return Result.of(c, solver, found, about[0] if about else None, variances, data.y.size / kappa)


def _frictions(
    data: Data, solvers: Mapping[str, Solver], fits: Mapping[Candidate, Fit], peak: float
) -> list[Friction]:
    """Every ε that is tried, under the best law and all terms; none where no friction stands out.

    peak: velocity of the reference, whose shares they are.
    """
    terms = next(iter(solvers.values())).terms
    switching = [i for i, t in enumerate(terms) if TERMS.get(t).switches]
    if not fits or not switching:
        return []
    best = min(fits, key=lambda c: fits[c].squares)
    top = fits[best]
    if not any(top.parameters.values(top.z)[i] > 0 for i in switching):
        return []
    m, law = len(terms), solvers[best.restoring].law_places

    def under(share: float) -> tuple[float, float, np.ndarray] | None:
        solver = replace(solvers[best.restoring], epsilon=share * peak)
        new = refit(solver, data, top)
        if new is None:
            return None
        return (
            share * peak,
            -0.5 * data.y.size * np.log(new.squares),
            new.parameters.values(new.z)[: law.start],
        )

    tried = [found for found in at_once(under, SHARES) if found is not None]
    for _ in range(BETWEEN if len(tried) > 2 else 0):
        between = _between(np.log([e / peak for e, _, _ in tried]), np.array([log for _, log, _ in tried]))
        new = None if between is None else under(float(np.exp(between)))
        if new is None:
            break
        tried.append(new)
    tried.sort(key=lambda found: -found[0])
    logs = np.array([log for _, log, _ in tried])
    weights = np.exp(logs - logs.max()) * _cells(np.log([e for e, _, _ in tried]))
    shares = weights / weights.sum()
    each = zip(tried, shares.tolist(), strict=True)
    return [Friction(e, w, tuple(p[:m].tolist()), tuple(p[m:].tolist())) for (e, _, p), w in each]


def _between(at: np.ndarray, logs: np.ndarray) -> float | None:
    """Log of a width between those that were tried, at (k,), where the likeliest, of log likelihoods (k,), is `TOLD`
    ahead of a neighbour: where a parabola through the three has its top. None where it stands at an end, and where
    what lies between tells nothing more."""
    order = np.argsort(at)
    at, logs = at[order], logs[order]
    i = int(np.argmax(logs))
    if i in (0, at.size - 1) or logs[i] - min(logs[i - 1], logs[i + 1]) < TOLD:
        return None
    three = slice(i - 1, i + 2)
    bend, slope, _ = np.polyfit(at[three] - at[i], logs[three], 2)
    top = -0.5 * slope / bend
    sd = 1 / np.sqrt(-2 * bend)
    if abs(top) < sd:  # the likeliest stands there already: its neighbours are what is too far
        wide = at[i + 1] - at[i] > at[i] - at[i - 1]
        top = min(2 * sd, 0.5 * (at[i + 1] - at[i])) if wide else -min(2 * sd, 0.5 * (at[i] - at[i - 1]))
    return float(at[i] + np.clip(top, 0.75 * (at[i - 1] - at[i]), 0.75 * (at[i + 1] - at[i])))


def _cells(at: np.ndarray) -> np.ndarray:
    """How much of a line each of the points at (k,), in order, stands for, the ends for as much to either side."""
    if at.size < 2:
        return np.ones(at.size)
    gaps = np.abs(np.diff(at))
    return 0.5 * (np.append(gaps, gaps[-1]) + np.append(gaps[0], gaps))


def _corrected(solvers: dict[str, Solver], fits: Mapping[Candidate, Fit]) -> None:
    """Averaged motions set right by the ODE, under each law at the fit of most terms."""
    most: dict[str, Fit] = {}
    for c, found in sorted(fits.items(), key=lambda item: len(item[0].damping)):
        most[c.restoring] = found

    def right(law: str) -> AveragedSolver | None:
        solver, at = solvers[law], most[law]
        assert isinstance(solver, AveragedSolver)
        return solver.corrected(at.parameters.values(at.z), at.active)

    for law, solver in zip(most, at_once(right, most), strict=True):
        if solver is not None:
            solvers[law] = solver


def _refitted(data: Data, solvers: Mapping[str, Solver], fits: dict[Candidate, Fit]) -> None:
    """Fits anew under the solvers' ε."""
    every = list(fits)
    found = at_once(lambda c: refit(solvers[c.restoring], data, fits[c]), every)
    for c, new in zip(every, found, strict=True):
        if new is not None:
            fits[c] = new


def _noise(
    data: Data, wholes: Mapping[str, tuple[Linearised, float]], approximate: bool
) -> tuple[float, float]:
    """The variance that counts, and κ in it, from the sum of all terms under the law that leaves least.

    Amplitudes and phases have the noise near the oscillation alone. Where laws hold exactly and nothing of the residual
    can be predicted it is white, and κ, which a short record tells to a few ten per cent only, is 1.
    """
    at, variance = min(wholes.values(), key=lambda found: found[1])
    white = bool(data.averaged) or (not approximate and predictable(at.left) == 0.0)
    kappa = 1.0 if white else inflation(data.t, at.left, data.frequency, at.u.size)
    return kappa * variance, kappa
