"""Sample the posterior of a candidate, and compute its summaries and damping ratios."""

from dataclasses import replace

import numpy as np

from bayesdamp.inference import diagnostics
from bayesdamp.inference.derived import Motions, derive_quantities, equivalent_ratio, units
from bayesdamp.inference.samplers import Settings
from bayesdamp.interface.posterior import Posterior, build_tree, draw
from bayesdamp.pipeline.answering import stored_answer
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.tasks import Product
from bayesdamp.store.files import netcdf_bytes, write_bytes
from bayesdamp.store.results import NO_DRAWS, PosteriorContent
from bayesdamp.types import Ratio

MOST_VALUES = 20_000
"""Approximate largest number of values in each of the groups posterior_predictive and log_likelihood of a file of
draws. For these groups, draws are thinned evenly. The draws themselves have about as many values, 0.2 MB
(conventional)."""


def compute_posterior(candidate: StudyCandidate, sampler: str, seed: int) -> Product:
    """Sample the posterior of a candidate with one sampler, write the draws to a netCDF file, and summarise them.

    The file is `posterior/SIGNAL.REPEAT.CANDIDATE.SAMPLER.nc` in the run's folder. The content of the result is a
    `PosteriorContent` with the summaries of parameters and derived quantities, and the damping ratios. The only array
    is `draws`, (chain, draw, parameter), in the units of the parameters.

    Raises Refusal if there is no fit, or if the sampler is not applicable to it.
    """
    s, fit, record = candidate.study.posterior, candidate.fit, candidate.record
    posterior, u = draw(fit, sampler, Settings(s.chains, s.warmup, s.draws, seed % 2**31))
    whole = Posterior(**vars(posterior), fit=fit, seed=seed, u=u)
    folder = candidate.store.folder
    file = folder / "posterior" / f"{candidate.path.replace('/', '.')}.{sampler}.nc"
    write_bytes(file, netcdf_bytes(build_tree(whole, MOST_VALUES)))
    motions = Motions(
        fit.oscillator,
        {**fit.known, **{n: posterior.draws[..., i] for i, n in enumerate(posterior.names)}},
        record.features.rest,
        record.content.scales.amplitude,
        candidate.spec.inertia,
    )
    summary = dict(posterior.summaries)
    derived = derive_quantities(motions)
    # A quantity that some draws do not have (no stable equilibrium, unbounded motion) gets no summary, as it would be
    # biased.
    partial = {n: int(np.sum(~np.isfinite(v))) for n, v in derived.items() if not np.all(np.isfinite(v))}
    for n, v in derived.items():
        if n not in partial:
            summary[n] = diagnostics.summarise(v, posterior.ensembles)
    unit = {**fit.units, **units(record.signal.unit)}
    content = PosteriorContent(
        posterior=replace(posterior, draws=NO_DRAWS[0], log_likelihood=NO_DRAWS[1], stats={}, summaries={}),
        units={n: unit[n] for n in summary},
        summary=summary,
        without=partial,
        file=file.relative_to(folder).as_posix(),
        ratios=_ratios(candidate, motions, u),
    )
    return Product(content, {"draws": posterior.draws}, posterior.outcome, posterior.seconds)


def _ratios(candidate: StudyCandidate, motions: Motions, u: np.ndarray) -> tuple[Ratio, ...]:
    """Return the damping ratio, from the draws, at each amplitude of the answer on the record; () without an answer.

    motions: motions of the draws if the laws hold exactly. u: the draws with their deviations from the laws, (chain,
    draw, K), with K unknowns; they are used instead if the fit allows deviations.
    """
    answer, law = stored_answer(candidate.record), candidate.fit.law
    amplitudes = tuple(r.amplitude for r in answer.verdict.damping_ratio) if answer else ()
    if law is not None:
        return law.ratios(amplitudes, u.reshape(-1, u.shape[-1]), candidate.study.posterior.sensor)
    ratios = []
    for amplitude in amplitudes:
        drawn = equivalent_ratio(motions.at(amplitude))
        low, middle, high = np.quantile(drawn, (0.025, 0.5, 0.975)).tolist()
        ratios.append(Ratio(amplitude, middle, low, high, float(drawn.std()), 0.0))
    return tuple(ratios)
