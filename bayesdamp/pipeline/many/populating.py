"""The mean and the spread of the damping over specimens, under one candidate for all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bayesdamp.config import Study
from bayesdamp.inference.deviation.specimen import priors_of
from bayesdamp.inference.many.population import Sample, population
from bayesdamp.physics.damping import parse_model
from bayesdamp.pipeline.many.joining import Arrays, coefficients_of, weighed_candidates
from bayesdamp.pipeline.many.specimens import Specimen
from bayesdamp.pipeline.tasks import Product
from bayesdamp.priors import Prior, SharedHalfNormal
from bayesdamp.store import Store
from bayesdamp.store.contents import JointCandidate, JointContent, PopulationContent, PopulationFound
from bayesdamp.types import OK, Refusal, candidate_parts
from bayesdamp.units import UNITS

WIDE = 3.0
"""Scale of the prior of a population's location, in units of the largest coefficient of a specimen, where the study
states no prior of the coefficient. Much wider than what the specimens' own intervals leave open."""


def populate(study: Study, store: Store) -> Product:
    """The population over all specimens (`population/specimens`). Raises Refusal where there is none."""
    specimens = [Specimen(study, label, specs, store) for label, specs in study.specimens.items()]
    assumed = sorted({s.deviation for s in specimens})
    if len(assumed) > 1:
        raise Refusal("no population: laws hold exactly for some specimens, approximately for others")
    bases = sorted({UNITS[s.specs[0].source.unit].base for s in specimens})
    if len(bases) > 1:
        raise Refusal(f"no population: some specimens are measured in {', others in '.join(bases)}")
    every = {s.name: candidates_of(s) for s in specimens}
    logs = {
        label: {c: r.log_evidence for c, r in rows.items() if r.log_evidence is not None}
        for label, (rows, _) in every.items()
    }
    common = set.intersection(*map(set, logs.values()))
    sums = {c: sum(one[c] for one in logs.values()) for c in specimens[0].candidates if c in common}
    joined = [c for c in sums if all(rows[c].summary for rows, _ in every.values())]
    if not joined:
        raise Refusal("no population: no model was weighed on every specimen")
    best = max(joined, key=lambda c: sums[c])
    draws = {label: arrays for label, (_, arrays) in every.items()}
    names = list(coefficients_of(draws[specimens[0].name], best))
    found = {n: _population_of(specimens, draws, best, n) for n in names}
    content = PopulationContent(
        deviation=assumed[0],
        best=best,
        log_evidence=sums,
        behind={label: max(one.values()) - one[best] for label, one in logs.items()},
        specimens={label: rows[best] for label, (rows, _) in every.items()},
        units=specimens[0].units(best, names),
        populations=found,
    )
    warnings = dict.fromkeys(p.outcome for p in found.values() if p.outcome != OK)
    return Product(content, outcome="; ".join(warnings) or OK)


def _population_of(
    specimens: Sequence[Specimen], draws: Mapping[str, Arrays], candidate: str, name: str
) -> PopulationFound:
    samples = [
        Sample(
            label, a[f"{candidate}/{name}"], np.zeros(a[f"{candidate}/{name}"].size),
            a[f"{candidate}/{name}/log_prior"],
        )
        for label, a in draws.items()
    ]  # fmt: skip
    damping = "+".join(parse_model(candidate_parts(candidate)[0]))
    priors = [priors_of(damping, s.reference, s.priors)[name] for s in specimens]
    scale = location_scale(priors, [float(np.mean(s.values)) for s in samples])
    return PopulationFound(scale, **vars(population(samples, scale)))


def location_scale(priors: Sequence[Prior], means: Sequence[float]) -> float:
    """Return the scale of the half-normal prior of a population's location.

    Parameters
    ----------
    priors
        Of the coefficient, one for each specimen. A stated one has a scale; of several the geometric mean is taken. The
        default one has none: then the scale is `WIDE` times the largest mean.
    means
        Posterior means of the coefficient, one for each specimen.
    """
    if any(isinstance(p, SharedHalfNormal) for p in priors):
        return WIDE * max(means)
    return float(np.exp(np.mean(np.log([float(p.value(1.0)) for p in priors]))))


def candidates_of(specimen: Specimen) -> tuple[Mapping[str, JointCandidate], Arrays]:
    """Return each candidate on a specimen and its draws: from the joint fit, or from its only record. None of them
    where it has no fit."""
    if len(specimen.records) > 1:
        cell = specimen.store.read(f"joint/{specimen.name}")
        content = JointContent.maybe(cell)
        return (content.candidates, dict(cell.arrays)) if content else ({}, {})
    try:
        return weighed_candidates(specimen)
    except Refusal:
        return {}, {}
