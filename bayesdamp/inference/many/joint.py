"""The joint posterior of one candidate over several records of one specimen, and its mode.

Shared parameters have one prior, and one value in all records; what belongs to a record alone (its start, the angle
at rest, which an encoder may offset, its noise) keeps a prior of its own. Both as scores, so that the joint log
density is the sum of the records' log likelihoods and a standard normal in all coordinates; a scale that damping
coefficients share is held at 1 where the mode is looked for, and averaged over in the evidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from bayesdamp.inference.coordinates.whitening import FAR
from bayesdamp.inference.fit.laplace import log_integral_over_scales
from bayesdamp.inference.fit.maximise import maximise
from bayesdamp.inference.fit.search import PLANS
from bayesdamp.inference.many.record import Local, Record
from bayesdamp.inference.model.density import LOG_2PI
from bayesdamp.priors import SHARED_SIGMAS, SharedHalfNormal
from bayesdamp.types import Refusal

ANGLES = ("spring_angle", "rest_angle")
"""Parameters of a law that are never shared: each record may have been taken with another zero of the encoder."""
HOPELESS = 1000.0
"""Nats that a common value of what is shared would cost, from which no joint mode is looked for: the search would be
long, far from all that the records say, and nobody could use what it found."""
AT_WALLS = 4
"""Reflected scores near zero whose joint orthant Laplace's look takes; of more, those that are cut most."""


class Apart(Refusal):
    """The records differ too much in what they would share. nats: what a common value of it would cost."""

    def __init__(self, shared: tuple[str, ...], nats: float) -> None:
        names = ", ".join(shared)
        super().__init__(
            f"the records disagree: a common value of {names} would cost {nats:.0f} nats; no joint fit"
        )
        self.nats = nats


def damping_parameters(record: Record) -> tuple[str, ...]:
    """Names of the damping parameters that a record infers, ε among them; not those of terms that it lacks."""
    own = [n for n in record.oscillator.coefficients if n in record.live]
    return (*own, *(["epsilon"] if "epsilon" in record.priors else []))


def law_parameters(record: Record) -> tuple[str, ...]:
    """Names of the restoring law's parameters that a record infers and records of one specimen can share."""
    return tuple(n for n in record.oscillator.law.parameters if n in record.priors and n not in ANGLES)


@dataclass(frozen=True)
class Joint:
    """One candidate over the records of one specimen.

    shared: the parameters that have one value in all of them. Coordinates x are the shared scores and then each
    record's own, shape (d,); scores on which nothing depends are left out of them.
    Raises Refusal where a shared parameter does not have one prior in all records.
    """

    records: tuple[Record, ...]
    shared: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in self.shared:
            priors = [r.priors.get(name) for r in self.records]
            if None in priors or any(p != priors[0] for p in priors):
                raise Refusal(f"{name} cannot be shared: its prior is not the same for all records")

    @cached_property
    def live(self) -> tuple[tuple[str, ...], ...]:
        """Of each record, the parameters of its own that something depends on."""
        return tuple(tuple(n for n in r.live if n not in self.shared) for r in self.records)

    @cached_property
    def parts(self) -> tuple[np.ndarray, ...]:
        """Of each record, the coordinates of its own scores."""
        ends = np.cumsum([len(self.shared), *map(len, self.live)])
        return tuple(np.arange(a, b) for a, b in pairwise(ends))

    @cached_property
    def reflected(self) -> np.ndarray:
        """Which coordinates are reflected, (d,) of bool."""
        first = [self.records[0].priors[n].reflected for n in self.shared]
        own = [r.priors[n].reflected for r, names in zip(self.records, self.live, strict=True) for n in names]
        return np.asarray([*first, *own], bool)

    @cached_property
    def scaled(self) -> np.ndarray:
        """Which coordinates are coefficients whose priors share an unknown scale, (d,) of bool: one scale for the
        shared coefficients, one for each record's own."""
        first = [isinstance(self.records[0].priors[n], SharedHalfNormal) for n in self.shared]
        own = [
            isinstance(r.priors[n], SharedHalfNormal)
            for r, names in zip(self.records, self.live, strict=True)
            for n in names
        ]
        return np.asarray([*first, *own], bool)

    def places(self, record: int) -> tuple[np.ndarray, np.ndarray]:
        """Where the shared scores and the own ones stand among a record's scores."""
        names = list(self.records[record].priors)
        return (
            np.asarray([names.index(n) for n in self.shared], int),
            np.asarray([names.index(n) for n in self.live[record]], int),
        )

    def scores(self, record: int, shared: np.ndarray, own: np.ndarray) -> np.ndarray:
        """A record's scores, (..., d_j), from the shared ones, (..., k), and its own, (..., m)."""
        z = np.zeros((*own.shape[:-1], len(self.records[record].priors)))
        at, mine = self.places(record)
        z[..., at], z[..., mine] = shared, own
        return z

    def split(self, x: np.ndarray) -> list[np.ndarray]:
        """Every record's scores at the coordinates x, (d,)."""
        k = len(self.shared)
        return [self.scores(j, x[:k], x[part]) for j, part in enumerate(self.parts)]

    def values(self, shared: np.ndarray) -> dict[str, np.ndarray]:
        """Shared parameters at their scores, (..., k): name to array of shape (...)."""
        priors = self.records[0].priors
        return {n: np.asarray(priors[n].value(shared[..., i])) for i, n in enumerate(self.shared)}


@dataclass(frozen=True)
class JointMode:
    """The mode of a joint posterior.

    local: each record's likelihood about it; x: coordinates, (d,); gradient, information: of the joint log posterior
    there, (d,) and (d, d), with which `log_posterior` is a density of the scores on both sides of zero.
    """

    joint: Joint
    local: tuple[Local, ...]
    x: np.ndarray
    log_posterior: float
    gradient: np.ndarray
    information: np.ndarray
    evaluations: int
    converged: bool

    def look(self) -> float:
        """Laplace's log evidence: for choosing and pruning, without an error estimate."""
        reflected = np.flatnonzero(self.joint.reflected)
        sd = np.sqrt(np.diag(np.linalg.inv(self.information)))
        mean = self.x + np.linalg.solve(self.information, self.gradient)
        room = (mean / sd)[reflected]
        near = reflected[np.argsort(room)[:AT_WALLS]]
        near = near[(mean / sd)[near] < FAR]
        shared = self.joint.scaled & (np.arange(self.x.size) < len(self.joint.shared))
        inside = log_integral_over_scales(
            self.log_posterior, self.gradient, self.information, self.x, near, shared, SHARED_SIGMAS
        )
        return inside + (reflected.size - near.size) * float(np.log(2.0))


def find_joint_mode(joint: Joint, starts: Sequence[Mapping[str, float]]) -> JointMode:
    """The mode that is reached from the records' own ones.

    starts: each record's parameter values at its own mode. Raises Apart where these are too far from each other for a
    search to make sense, Refusal where the joint posterior is not finite on the way.
    """
    local = [r.about(r.scores(values)) for r, values in zip(joint.records, starts, strict=True)]
    x, evaluations, attempts = _start(joint, local), len(local), 0
    apart = sum(at.cost(z) for at, z in zip(local, joint.split(x), strict=True))
    if apart > HOPELESS:
        raise Apart(joint.shared, apart)
    while True:
        attempts += 1
        local = [
            at if at.holds(z) else record.about(z)
            for at, record, z in zip(local, joint.records, joint.split(x), strict=True)
        ]
        top = maximise(_curvature(joint, local), joint.reflected, x)
        x, evaluations = top.x, evaluations + top.evaluations * len(local)
        if not np.isfinite(top.value):
            raise Refusal("the records have no joint mode that can be reached from their own ones")
        near = all(at.holds(z) for at, z in zip(local, joint.split(x), strict=True))
        if near or attempts == PLANS:
            gradient = _curvature(joint, local)(x)[1]
            return JointMode(
                joint,
                tuple(local),
                x,
                top.value,
                gradient,
                top.information,
                evaluations,
                top.converged and near,
            )


def _start(joint: Joint, modes: Sequence[Local]) -> np.ndarray:
    """The mean of the records' shared scores, weighted by what each knows of them, and their own ones there."""
    k = len(joint.shared)
    known, pulled, follow = np.zeros((k, k)), np.zeros(k), []
    for j, mode in enumerate(modes):
        at, mine = joint.places(j)
        h = mode.information
        slope = -np.linalg.solve(h[np.ix_(mine, mine)], h[np.ix_(mine, at)])
        weight = h[np.ix_(at, at)] + h[np.ix_(at, mine)] @ slope
        known, pulled = known + weight, pulled + weight @ mode.z[at]
        follow.append(slope)
    mean = np.linalg.solve(known, pulled) if k else pulled
    own = []
    for j, (mode, slope) in enumerate(zip(modes, follow, strict=True)):
        at, mine = joint.places(j)
        own.append(mode.z[mine] + slope @ (mean - mode.z[at]))
    return np.concatenate([mean, *own])


def _curvature(joint: Joint, local: Sequence[Local]):
    """x to the joint log posterior, its gradient (d,) and information (d, d)."""
    k, d = len(joint.shared), joint.reflected.size

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        value = -0.5 * float(x @ x) - 0.5 * d * LOG_2PI
        gradient, information = -x.copy(), np.eye(d)
        for j, z in enumerate(joint.split(x)):
            own, slope, curved = local[j].curvature(z)
            value += own
            names, places = np.concatenate(joint.places(j)), np.r_[np.arange(k), joint.parts[j]]
            gradient[places] += slope[names]
            information[np.ix_(places, places)] += curved[np.ix_(names, names)]
        return np.asarray(value), gradient, information

    return at
