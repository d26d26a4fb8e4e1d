"""Sample the posterior of a candidate, and compute its summaries and damping ratios."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayesdamp.inference import diagnostics
from bayesdamp.inference.derived import Motions, derive_quantities, equivalent_ratio, units
from bayesdamp.inference.samplers import Settings
from bayesdamp.interface.posterior import draw
from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.pipeline.answering import stored_answer
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.tasks import Product
from bayesdamp.store.contents import NO_DRAWS, PosteriorContent
from bayesdamp.store.files import write_bytes
from bayesdamp.types import Ratio

SIZES = ("damping_deviation_size", "frequency_deviation_size")
"""Names of two variables in the file of draws: the sizes of the deviations of damping and frequency from their laws,
relative to the laws, as energy-weighted means over the record of |deviation − its mean|."""


def compute_posterior(candidate: StudyCandidate, sampler: str, seed: int) -> Product:
    """Draw with one sampler, write the draws to a file (netCDF), and summarise them.

    The content is a `PosteriorContent` with the summaries of parameters and derived quantities, and the damping ratios;
    the only array is `draws`, (chain, draw, parameter), in the units of the parameters.

    Raises Refusal if there is no fit, or the sampler cannot work on it.
    """
    s, signal = candidate.study.posterior, candidate.record.signal
    posterior, u = draw(candidate.fit, sampler, Settings(s.chains, s.warmup, s.draws, seed % 2**31))
    whole, law = posterior, candidate.fit.law
    if law is not None:
        u = u.reshape(-1, u.shape[-1])
        sizes = np.stack([x.reshape(posterior.draws.shape[:2]) for x in law.sizes(u)], axis=-1)
        draws = np.concatenate([posterior.draws, sizes], axis=-1)
        whole = replace(posterior, names=(*posterior.names, *SIZES), draws=draws)
    folder = candidate.store.folder
    file = folder / "posterior" / f"{candidate.path.replace('/', '.')}.{sampler}.nc"
    write_bytes(file, diagnostics.to_netcdf(whole))
    target, record = candidate.fit.engine[0], candidate.record
    values = {**target.known, **{n: posterior.draws[..., i] for i, n in enumerate(posterior.names)}}
    motions = Motions(
        target.oscillator,
        values,
        record.features.rest,
        record.content.scales.amplitude,
        candidate.spec.inertia,
    )
    summary = dict(posterior.summaries)
    derived = derive_quantities(motions)
    # A quantity that some draws do not have (no stable equilibrium, an escape) gets no summary: it would be biased.
    partial = {n: int(np.sum(~np.isfinite(v))) for n, v in derived.items() if not np.all(np.isfinite(v))}
    for n, v in derived.items():
        if n not in partial:
            summary[n] = diagnostics.summarise(v, posterior.ensembles)
    unit = units(signal.unit)
    content = PosteriorContent(
        posterior=replace(posterior, draws=NO_DRAWS[0], log_likelihood=NO_DRAWS[1], stats={}, summaries={}),
        units={
            n: unit.get(n) or parameter_unit(n, candidate.restoring, signal.unit, signal.quantity)
            for n in summary
        },
        summary=summary,
        without=partial,
        file=file.relative_to(folder).as_posix(),
        ratios=_ratios(candidate, motions, u),
    )
    return Product(content, {"draws": posterior.draws}, posterior.outcome, posterior.seconds)


def _ratios(candidate: StudyCandidate, motions: Motions, u: np.ndarray) -> tuple[Ratio, ...]:
    """Return the damping ratio of the draws at each amplitude of the answer on the record; () without an answer.

    motions: of the draws under exact laws. u: draws with their deviations, (n, K); used instead if the fit has
    deviations from the laws.
    """
    answer, law = stored_answer(candidate.record), candidate.fit.law
    amplitudes = tuple(r.amplitude for r in answer.verdict.damping_ratio) if answer else ()
    if law is not None:
        return law.ratios(amplitudes, u, candidate.study.posterior.sensor)
    ratios = []
    for amplitude in amplitudes:
        drawn = equivalent_ratio(motions.at(amplitude))
        low, middle, high = np.quantile(drawn, (0.025, 0.5, 0.975)).tolist()
        ratios.append(Ratio(amplitude, middle, low, high, float(drawn.std()), 0.0))
    return tuple(ratios)
