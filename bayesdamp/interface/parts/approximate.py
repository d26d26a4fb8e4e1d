"""A model on a record where laws may hold approximately: its numbers, its motions, and draws of them."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bayesdamp.inference.checks.diagnostics import summarise
from bayesdamp.inference.deviation.candidate import Candidate
from bayesdamp.inference.deviation.data import prepared
from bayesdamp.inference.deviation.findings import default_amplitudes
from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of
from bayesdamp.inference.deviation.gaussian.tempered import Sampled
from bayesdamp.inference.deviation.numbers.averaging import START, averaging_of
from bayesdamp.inference.deviation.numbers.curves import ratio_at
from bayesdamp.inference.deviation.numbers.deviations import size_of
from bayesdamp.inference.deviation.numbers.draws import Drawn, scores_of
from bayesdamp.inference.deviation.numbers.quantities import Quantity, Ratio, quantity
from bayesdamp.inference.deviation.quick import MOST_CYCLES
from bayesdamp.inference.deviation.sampled.candidates import sampled_result
from bayesdamp.inference.deviation.single import Found, Single, again, single
from bayesdamp.inference.deviation.weighing import Friction
from bayesdamp.inference.model.defaults import Reference
from bayesdamp.interface.model import Model, prior_of
from bayesdamp.interface.parts.case import Case
from bayesdamp.machine.threads import at_once
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.kernel.solve import NONE
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.pipeline.answer import in_base
from bayesdamp.types import OK
from bayesdamp.units import Unit

if TYPE_CHECKING:
    import pandas as pd

    from bayesdamp.interface.records.signal import Signal

Array = NDArray[np.float64]
DRAWS = 4000
"""Of the linear model, behind values and intervals: an end of an interval is good to a thirtieth of its width."""
APART = 1_000_003
"""Between the seeds of independent runs."""


@dataclass(frozen=True)
class Approximate:
    """A candidate with deviations of its damping and restoring laws, linear about its best motion, and what is asked
    of it.

    single: what was weighed; sensor: relative sd below which no damping ratio is known.
    """

    single: Single
    sensor: float

    @staticmethod
    def of(case: Case) -> Approximate:
        """Fit it. Raises Refusal where that cannot be done."""
        model = case.model
        coefficients = {t.name: t.parameter for t in Oscillator(model.terms, model.restoring).terms}
        priors = {coefficients.get(n, n): p for n, p in model.priors.items()}
        weighed = partial(
            single,
            damping=model.terms,
            restoring=model.restoring,
            known=model.known,
            priors=priors,
            reference=case.reference,
        )
        found = weighed(prepared(case.signal, average=not any(n in model.known for n in START)))
        averaging = averaging_of(found.weighing)
        if averaging is not None and not averaging.close and averaging.cycles <= MOST_CYCLES:
            found = weighed(prepared(case.signal, average=False))
        return Approximate(found, model.sensor)

    @cached_property
    def scores(self) -> Array:
        """Draws of the linear model: scores, log g and h at the knots, (n, K)."""
        result = self.single.result
        assert result.weighed is not None
        return scores_of(result.weighed, result.fit.parameters.positive, DRAWS, np.random.default_rng(0))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the inferred parameters."""
        return self.single.result.fit.parameters.free_names

    @property
    def oscillator(self) -> Oscillator:
        """Its laws, as if they held exactly."""
        candidate = self.single.result.candidate
        return Oscillator(candidate.damping, candidate.restoring)

    @property
    def known(self) -> dict[str, float]:
        """What is held: parameters, friction's width where there is any, and the noise's sd of a sample."""
        weighing = self.single.weighing
        own = (*self.oscillator.parameters, "noise_sd")
        found = {n: v for n, v in self.single.found.known.items() if n in own}
        found |= {"epsilon": weighing.epsilon} if self.oscillator.switches else {}
        variance = weighing.variance / weighing.inflation * weighing.data.thinned
        return {**found, "noise_sd": float(np.sqrt(variance))}

    def values(self, u: Array) -> Array:
        """Inferred parameters in natural units of draws (..., K): (..., p)."""
        parameters = self.single.result.fit.parameters
        return parameters.values(u[..., : parameters.free.size])[..., parameters.free]

    def quantities(self) -> dict[str, Quantity]:
        """Each inferred parameter: median, 95 % interval, and the parts of its sd."""
        values, noise = self.values(self.scores), self.noise_sds
        return {
            n: quantity(values[:, i], min(noise[n], float(np.std(values[:, i]))))
            for i, n in enumerate(self.names)
        }

    @cached_property
    def noise_sds(self) -> dict[str, float]:
        """The sd that noise alone would leave of each inferred parameter, were the laws exact."""
        result, parameters = self.single.result, self.single.result.fit.parameters
        sds = np.linalg.norm(result.exact_weighed.factors[0], axis=1) * np.abs(
            parameters.slopes(result.fit.z)
        )
        sds = sds * np.sqrt(self.single.weighing.variance / result.exact_variance)
        return dict(zip(self.names, map(float, sds), strict=True))

    def deviations(self, u: Array) -> tuple[Array, Array]:
        """Log g and h at the knots of draws (n, K): (n, k) each."""
        d, k = self.single.result.fit.z.size, self.knots.size
        return u[:, d : d + k], u[:, d + k :]

    @property
    def knots(self) -> Array:
        """Times in s from the first sample."""
        return self.single.result.solver.knots * self.single.result.solver.slowness

    def sizes(self, u: Array) -> tuple[Array, Array]:
        """Energy-weighted mean of |log g| and |h| over the record, of draws (n, K): (n,) each."""
        g, h = self.deviations(u)
        one = self.single
        return size_of(one.weighing, one.result, g), size_of(one.weighing, one.result, h)

    def ratios(self, amplitudes: tuple[float, ...], u: Array) -> tuple[Ratio, ...]:
        """Equivalent damping ratios at amplitudes (rad or m), deviation and the sensor's floor among their sds."""
        result, solver = self.single.result, self.single.result.solver
        values = result.fit.parameters.values(u[:, : result.fit.z.size])
        m, law = len(solver.terms), solver.law_places
        drawn = Drawn(result, values[:, :m], values[:, m : law.start], values[:, law], *self.deviations(u))
        rng = np.random.default_rng(1)
        return tuple(ratio_at(self.single.weighing, [drawn], a, self.sensor, rng) for a in amplitudes)

    def motions(self, u: Array, t: Array | None = None, quantity: str | None = None) -> Array:
        """Motions of draws (n, K) at times t (m,) in s within the knots, (n, m); nan where one escapes. By default at
        the samples that are fitted, in their quantity."""
        result, solver = self.single.result, self.single.result.solver
        if t is not None:
            solver = solver.at(np.asarray(t, float), quantity or solver.quantity)
        parameters = result.fit.parameters
        g, h = self.deviations(u)
        none = np.full(solver.t.size, np.nan)

        def one(i: int) -> Array:
            p = parameters.values(u[i, : parameters.free.size])
            found = solver.solve(p, result.fit.active, np.expm1(g[i]), h[i], NONE)
            return none if found is None else found.y

        assert solver.kernel  # compiled before several threads ask for it
        return np.stack(at_once(one, range(len(u)))) if len(u) else np.empty((0, none.size))

    @property
    def best(self) -> Array:
        """u of the best motion with its deviations, (1, K)."""
        about = self.single.result.about
        assert about is not None
        return about.u[None]

    def log_likelihoods(self, motions: Array) -> Array:
        """Log density of each sample of motions (..., n), in nats: with κ > 1 a sample counts for 1/κ of one, and its
        noise's variance is κ times larger, so that their sum is the log likelihood that was weighed."""
        weighing = self.single.weighing
        variance, kappa = weighing.variance, weighing.inflation
        left = np.asarray(weighing.data.y) - motions
        return -0.5 * left**2 / variance - 0.5 * np.log(2 * np.pi * variance) / kappa

    def prior_draws(self, count: int, seed: int) -> Array:
        """u under the prior, (n, K)."""
        result, rng = self.single.result, np.random.default_rng([seed, 1])
        parameters = result.fit.parameters
        grid = grid_of(self.knots.size, absorbed=parameters.absorbs)
        z = rng.standard_normal((count, parameters.free.size))
        z[:, parameters.positive] = np.abs(z[:, parameters.positive])
        mass = np.exp(grid.log_prior - grid.log_prior.max())
        combos = rng.choice(mass.size, count, p=mass / mass.sum())
        smooth = np.einsum(
            "nij,nj->ni", grid.factors[combos], rng.standard_normal((count, 2 * self.knots.size))
        )
        return np.concatenate([z, smooth], axis=1)

    def packed(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """As a file holds it: what JSON can hold, and arrays."""
        found = self.single.found
        meta: dict[str, Any] = {
            "terms": found.terms,
            "reference": [found.reference.amplitude, found.reference.frequency],
            "priors": {n: p.model_dump() for n, p in found.priors.items()},
            "known": dict(found.known),
            "numbers": [found.variance, found.inflation, found.exact_variance, found.epsilon],
            "averaged": found.averaged,
            "frictions": [[f.epsilon, f.weight, f.coefficients.tolist()] for f in found.frictions],
        }
        return meta, {"z": found.z, "u": found.u}

    @staticmethod
    def unpacked(
        signal: Signal, model: Model, meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]
    ) -> Approximate:
        """What `packed` gave."""
        found = Found(
            tuple(meta["terms"]),
            Reference(*meta["reference"]),
            {n: prior_of(p) for n, p in meta["priors"].items()},
            dict(meta["known"]),
            arrays["z"],
            arrays["u"],
            *meta["numbers"],
            frictions=tuple(Friction(e, w, np.array(c)) for e, w, c in meta["frictions"]),
            averaged=bool(meta.get("averaged", False)),
        )
        candidate = Candidate(
            tuple(t for t in found.terms if TERMS.get(t).parameter in found.priors), model.restoring
        )
        return Approximate(again(prepared(signal, found.averaged), candidate, found), model.sensor)


def ratios_of(
    approximate: Approximate, amplitudes: Sequence[float] | None, u: Array, unit: Unit
) -> pd.DataFrame:
    """A row for each amplitude: amplitude and its unit, value, sd_noise, sd_law, low, high. unit: of the amplitudes,
    asked for and given. Raises InputError for one that the record does not have."""
    import pandas as pd

    weighing = approximate.single.weighing
    wanted = in_base(amplitudes, weighing, unit) or default_amplitudes(weighing)
    own = unit.displacement
    rows = [
        {**asdict(r), "amplitude": r.amplitude * own.scale, "unit": own.name}
        for r in approximate.ratios(wanted, u)
    ]
    columns = ["amplitude", "unit", *(name for name in rows[0] if name not in ("amplitude", "unit"))]
    return pd.DataFrame(rows, columns=columns)


@dataclass(frozen=True)
class Runs:
    """Independent runs of the tempered sampler. u: (run, draw, K); log_likelihood: (run, draw), nats; each run's own
    record: evidence and its standard error, temperatures, acceptance of the last moves."""

    u: Array
    log_likelihood: Array
    each: tuple[Sampled, ...]
    seconds: float

    @property
    def log_evidence(self) -> tuple[float, float]:
        """In nats, from the mean of the runs' evidences, with its standard error."""
        logs = np.array([r.log_evidence for r in self.each])
        top = float(logs.max())
        if not np.isfinite(top):
            return top, float("nan")
        weights = np.exp(logs - top)
        errors = np.array([r.stderr for r in self.each])
        stderr = float(np.sqrt(np.sum((weights * errors) ** 2)) / weights.sum())
        return top + float(np.log(weights.mean())), stderr

    @property
    def outcome(self) -> str:
        """ "ok", or why they are not to be trusted."""
        poor = [r.acceptance for r in self.each if not r.trusted]
        if not poor:
            return OK
        return f"the motions could not be led to from the linear model: {min(poor):.2f} of the last moves were taken"


def runs_of(approximate: Approximate, chains: int, draws: int, seed: int) -> Runs:
    """Draws of the motions themselves, by so many independent runs; the first is `compare`'s for as many draws."""
    began, one = time.perf_counter(), approximate.single
    each, rows = [], []
    for chain in range(chains):
        found = sampled_result(one.weighing, one.result, True, seed + APART * chain, draws).sampled
        assert found is not None
        each.append(found)
        # A run leaves its draws in the order of what they descend from, which is none of time.
        rows.append(found.draws[np.random.default_rng([seed, chain]).permutation(draws)])
    u = np.stack(rows)
    motions = approximate.motions(u.reshape(-1, u.shape[-1]))
    total = approximate.log_likelihoods(motions).sum(axis=1).reshape(u.shape[:2])
    return Runs(u, total, tuple(each), time.perf_counter() - began)


def summaries_of(
    approximate: Approximate, draws: Array, ensembles: int | None = None
) -> dict[str, dict[str, float]]:
    """Of draws (chain, draw, parameter), by name; draws that were copied in the last resampling count once.

    ensembles: into which the chains fall, where those of one share their moves."""
    found = {}
    for i, name in enumerate(approximate.names):
        one = summarise(draws[..., i], ensembles)
        distinct = float(np.unique(draws[..., i]).size)
        noise = min(approximate.noise_sds[name], one["sd"])
        parts = {"sd_noise": noise, "sd_law": float(np.sqrt(one["sd"] ** 2 - noise**2))}
        ess = {k: min(one[k], distinct) for k in ("ess_bulk", "ess_tail")}
        found[name] = {**one, **ess, **parts}
    return found
