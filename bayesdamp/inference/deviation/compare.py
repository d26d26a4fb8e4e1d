"""Compare all candidates on one record within seconds, on averaged motions where these are accurate.

A candidate is a sum of damping terms under a restoring law. The docstring of `bayesdamp.inference.deviation` explains
the words and the steps.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from bayesdamp.inference.deviation.averaged import MOST_CYCLES, Averaging
from bayesdamp.inference.deviation.candidate import START, MotionCandidate
from bayesdamp.inference.deviation.data import prepare_data
from bayesdamp.inference.deviation.forms import add_rivals, columns_of
from bayesdamp.inference.deviation.model_comparison import Known, ModelComparison, compare_candidates
from bayesdamp.inference.deviation.sample_noise import AUTOMATIC, prepare_for_noises
from bayesdamp.inference.deviation.slices import exponent_quantiles
from bayesdamp.machine import at_once
from bayesdamp.physics.damping import all_sums, parse_model
from bayesdamp.physics.kernel.averaged import AveragedSolver
from bayesdamp.physics.oscillator import check_restoring
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import Prior
from bayesdamp.types import Reference, Signal


def compare_signal(
    signal: Signal,
    *,
    damping: Sequence[str] = (),
    restoring: Sequence[str] = (),
    known: Known | None = None,
    priors: Mapping[str, Prior] | None = None,
    reference: Reference | None = None,
    approximate: bool = True,
    noises: Sequence[str] = AUTOMATIC,
) -> ModelComparison:
    """Compare sums of damping terms under restoring laws on a record, by their evidence.

    A record of at least 400 cycles is reduced to amplitudes and phases where this is possible (`average_of`), and its
    motions are averaged over cycles, unless the initial displacement or velocity is known. Averaged motions are
    corrected by the full equation of motion. If the remaining error shifts a parameter of the best candidate by more
    than a tenth of its sd, the samples are compared instead, unless the record has more than `MOST_CYCLES` cycles.

    Parameters
    ----------
    signal : Signal
        The record.
    damping : sequence of str
        Damping sums: names of terms joined by +, such as "viscous+coulomb". By default the seven sums of viscous,
        Coulomb and quadratic damping.
    restoring : sequence of str
        Names of restoring laws. By default all laws, plug-ins included; but if the record's unit is not rad, only laws
        of a translation.
    known : mapping or callable, optional
        Values of parameters by name, or a function from the name of a restoring law to such a mapping. They may include
        `theta0` and `omega0` (initial displacement and velocity), `noise_sd` (sd of a sample's noise, in the record's
        unit) and `epsilon` (width of the velocity range in which dry friction changes its sign, in rad/s or m/s). A
        known value of a coefficient has no effect: it is inferred.
    priors : mapping of str to Prior, optional
        Priors by the name of the parameter; the others have default priors.
    reference : Reference, optional
        Amplitude and frequency with which default priors scale; by default the record's own, to two digits.
    approximate : bool
        Whether to allow deviations from the laws; if False, laws are exact.
    noises : sequence of str
        Names of the noise models from which one is chosen.

    Returns
    -------
    ModelComparison
        The fitted candidates with their evidences, the rivals (sums of damping terms with a form of damping that is not
        compared), and the quantiles of the exponent of a power law.

    Raises
    ------
    InputError
        If a name is unknown, a sum contains a term twice or two terms with the same parameter, an inferred parameter
        has neither a given nor a default prior, or a known value that must be above 0, such as a stiffness, is not.
    Refusal
        Where the record does not oscillate or has fewer than ten samples, no motion stays in phase with it, no
        candidate can be compiled, or none of the noise models applies.
    """
    laws = list(restoring) or [n for n in LAWS.names() if signal.unit == "rad" or LAWS.get(n).translates]
    sums = list(damping) or all_sums()
    compare = partial(
        compare_candidates,
        candidates=[MotionCandidate(parse_model(s), law) for law in laws for s in sums],
        known=known,
        priors=priors,
        reference=reference,
        approximate=approximate,
        noises=noises,
    )
    known_under = [dict(known(law) if callable(known) else known or {}) for law in laws]
    # An averaged motion starts only approximately at known initial values.
    start_known = any(name in values for values in known_under for name in START)
    # The matrices have a few dozen rows, so that threads of the linear algebra library would only cost time.
    with threadpool_limits(1, "blas"):
        data = prepare_for_noises(signal, noises, known_under[0], priors or {}, average=not start_known)
        for law, values in zip(laws, known_under, strict=True):
            check_restoring(law, values)
        comparison = compare(data)
        if data.averaged is not None and comparison.results:
            comparison = _correct_averages(comparison)
            averaging = averaging_of(comparison)
            if averaging is None or averaging.close or data.cycles > MOST_CYCLES:
                comparison = replace(comparison, averaging=averaging)
            else:
                comparison = compare(prepare_data(signal, average=False))
        comparison = add_rivals(comparison)
        return replace(comparison, exponents=exponent_quantiles(comparison))


def _correct_averages(comparison: ModelComparison) -> ModelComparison:
    """Return a copy of the comparison in which averaged motions are corrected (`ModelComparison.corrected`).

    In `solvers`, the solver of the best candidate replaces that of its restoring law.
    """
    comparison = replace(comparison, results=tuple(at_once(comparison.corrected, comparison.results)))
    best = comparison.best
    return replace(comparison, solvers={**comparison.solvers, best.candidate.restoring: best.solver})


def averaging_of(comparison: ModelComparison) -> Averaging | None:
    """Return the error in the best candidate's parameters because its motion is averaged over cycles.

    Motions are averaged for a record of very many cycles. The error is that which remains after the correction that the
    solver contains: the largest shift of an inferred parameter, in posterior sds; the initial state does not count. It
    is infinite if the motion cannot be solved. Return None if the record is not reduced to amplitudes and phases, or if
    the comparison has no results.
    """
    if comparison.data.averaged is None or not comparison.results:
        return None
    result, cycles = comparison.best, comparison.data.cycles
    assert isinstance(result.solver, AveragedSolver)
    off = result.solver.defect_at(result.values, result.fit.active, *result.deviations)
    base = columns_of(result)
    if off is None or base is None:
        return Averaging(cycles, float("inf"))
    posterior, pull = result.posterior, base[0].T @ off / result.variance
    shifts = posterior.factors @ (pull @ posterior.factors)[:, :, None]
    rows = [i for i, name in enumerate(result.fit.parameters.free_names) if name not in START]
    shares = np.abs(posterior.weights @ shifts[:, rows, 0]) / posterior.sds(np.eye(pull.size)[rows])
    return Averaging(cycles, float(np.max(shares, initial=0.0)))
