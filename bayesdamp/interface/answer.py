"""Compute the answer on one signal: which damping it has, how large it is, and how well the damping law holds.

`bayesdamp compare`, `bd.compare` and the tasks of a study all call `compare_models` and then `answer`. The docstring of
`bayesdamp.inference.deviation` describes how the damping models are compared.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from bayesdamp.config.signals import check_translation
from bayesdamp.formatting import digits, fixed_decimals
from bayesdamp.inference.deviation.candidate import START
from bayesdamp.inference.deviation.compare import compare_signal
from bayesdamp.inference.deviation.data import Data
from bayesdamp.inference.deviation.findings import SENSOR, Findings, compute_findings, picture, posterior_of
from bayesdamp.inference.deviation.forms import replaced_sum
from bayesdamp.inference.deviation.model_comparison import FAR_BEHIND, CandidateResult, Known, ModelComparison
from bayesdamp.inference.deviation.sample_noise import noises_of
from bayesdamp.inference.deviation.sampling import with_samples
from bayesdamp.inference.deviation.single import state_of
from bayesdamp.inference.deviation.specimen import RatioLikelihood, RunComparison, ratio_likelihood
from bayesdamp.inference.noise import GAUSSIAN, SampleNoise
from bayesdamp.interface.first_words import no_free_decay, remark_on
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import Prior
from bayesdamp.records.cleaning.window import other_decays
from bayesdamp.records.oscillation.law_free import LawFree, law_free
from bayesdamp.records.oscillation.modes import NATS_AHEAD
from bayesdamp.serial import join, split
from bayesdamp.store.results import (
    AnswerContent,
    CandidatePriors,
    ComparedCandidate,
    NoiseEvidence,
    SampledPosterior,
    StoredFit,
)
from bayesdamp.types import NORMAL_95, OK, UNITS, InputError, Reference, Refusal, Signal, Unit
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.decide import decide
from bayesdamp.verdict.parts import Averages, Grade, UsedWindow
from bayesdamp.verdict.specimen import RecordAnswer
from bayesdamp.verdict.types import Verdict

BEYOND = 1.3
"""Factor by which a requested amplitude may be above the record's first amplitude or below its last (conventional)."""
CURVE = ("amplitude", "ratio", "low", "high", "over", "over_sd")
"""Names of the arrays of a damping curve that a verdict on several records needs. `amplitude`: the amplitudes, in the
base unit. `ratio`, `low`, `high`: the damping ratio there, and the ends of its 95 % interval. `over`, `over_sd`: mean
and sd of ln(damping ratio / damping ratio without deviations from the damping law)."""
BY_LAW = ("ratio", "low", "high")
"""Names of the arrays with the damping ratio according to the damping laws, averaged over them by their probability,
and its 95 % interval. They are left out if the damping is measured without a law (`Verdict.law_free`)."""
CURVE_POINTS = 40
"""Number of amplitudes at which `measured_curve` gives the damping that is measured without assuming a law."""
OF_LAW = (*BY_LAW, "fit", "residual", "law/", "work/")
"""Prefixes of the names of all arrays that depend on a damping law. They are left out if the best law contradicts the
damping that is measured without a law (`Verdict.contradicted`)."""
RUN = "run/"
"""Prefix of the names of the arrays that contain each model's likelihood, which a verdict on several records needs."""
RUN_ARRAYS = {
    **dict.fromkeys(("coefficients", "mode", "per_unit", "growth")),
    "likelihood": dict.fromkeys(("log", "slope", "information")),
}
"""Fields of a `RatioLikelihood` (a model's likelihood as a function of its damping) that are stored as arrays, as a
nested dictionary for `serial.join`, which reads them back."""
JOINABLE = 40.0
"""Limit in nats (conventional) for the likelihoods that are stored for a verdict on several records. The likelihood of
a form of damping outside the compared sums is stored only if its log evidence is less than this below the largest one.
The likelihoods of the compared sums are always stored."""


@dataclass(frozen=True)
class Answer:
    """The answer on a record, in the form in which tasks and files store it.

    Attributes
    ----------
    content
        The verdict, the compared models and further results as plain values, with amplitudes in the record's base unit
        (rad, m or the sensor's unit).
    arrays
        Arrays for the figure, by name: those of `inference.deviation.findings.picture` (without those of `OF_LAW` or
        `BY_LAW` if the damping is measured without a law) and, if it can be measured, of `measured_curve`. For one of
        several records of a specimen (the object that was recorded), also each model's likelihood,
        `run/DAMPING@RESTORING/...`, `run/reference`, `over` and `over_sd` (see `_runs`). Empty if an oscillation has no
        answer. For an envelope, see `answer_envelope`.
    further
        Posterior draws, in natural units, of the models that were sampled without a doubt about the result
        (`draws/DAMPING@RESTORING`), and the arrays of the fits in `content.laws` (`found/DAMPING@RESTORING/...`). Empty
        for an envelope.
    """

    content: AnswerContent
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    further: Mapping[str, np.ndarray] = field(default_factory=dict)

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict on the record, restored from `content`, with amplitudes in the base unit."""
        return Verdict.from_dict(self.content.verdict)

    def of_specimen(self) -> RecordAnswer:
        """Return the part of this answer that a verdict on several records of a specimen needs.

        It contains the verdict, the log evidence and the likelihood of each model, and the damping curve (`CURVE`). Log
        evidences are relative to the largest one of the compared models. They allow for deviations from the damping and
        restoring laws. If one of the compared models has only a log evidence under exact laws, those under exact laws
        are used for all of them. The answer must be on an oscillation, contain `arrays`, and be computed with
        `repeated=True`.
        """
        rows, rivals = [r for r in self.content.candidates if r.outcome == OK], self.content.rivals
        exact = any(r.log_evidence is None for r in rows)

        def log_of(row: ComparedCandidate) -> float:
            return row.exact if exact or row.log_evidence is None else row.log_evidence

        top = max(map(log_of, rows))
        runs = {}
        for row in (*rows, *rivals):
            name = f"{RUN}{row.damping}@{row.restoring}"
            if f"{name}/mode" in self.arrays:
                run = join(RatioLikelihood, {"names": row.parameters, **RUN_ARRAYS}, self.arrays, name)
                runs[row.damping, row.restoring] = run.plus_nats(-top)
        comparison = RunComparison(
            {(r.damping, r.restoring): log_of(r) - top for r in rows},
            {r.damping: r.place for r in rivals},
            runs,
            Reference(*map(float, self.arrays.get(f"{RUN}reference", (1.0, 1.0)))),
            self.arrays["amplitude"],
        )
        return RecordAnswer(self.verdict, comparison, {n: self.arrays[n] for n in CURVE if n in self.arrays})


def law_prefix(damping: str, restoring: str) -> str:
    """Return the prefix "found/DAMPING@RESTORING" of the arrays of one model's fit in `Answer.further`."""
    return f"found/{damping}@{restoring}"


def compare_models(
    signal: Signal,
    *,
    deviation: str = "auto",
    damping: Sequence[str] = (),
    restoring: Sequence[str] = (),
    known: Known | None = None,
    priors: Mapping[str, Prior] | None = None,
    reference: Reference | None = None,
    noise: str | Sequence[str] = "auto",
) -> ModelComparison | Verdict:
    """Compare damping models on a signal by linear approximations; `answer` draws the conclusion.

    Parameters
    ----------
    signal
        The signal.
    deviation
        "none": the damping and restoring laws are assumed to hold exactly. "law" and "auto" (the default) have the same
        effect: deviations from them are inferred.
    damping, restoring
        Sums of damping terms, such as "viscous+coulomb", and restoring laws to compare. By default these are the seven
        sums of viscous, Coulomb and quadratic damping, and all laws that the unit of the signal allows. Other forms of
        damping are tried in addition.
    known
        Known values of parameters, by name, in `signal.unit` and s; or a function that returns such a dictionary for
        the name of a restoring law. Damping coefficients are always inferred; values for them have no effect.
    priors
        Priors by name of the parameter, such as "zeta"; the other parameters have default priors.
    reference
        Amplitude (in `signal.unit`) and angular frequency (rad/s) to which default priors are scaled; by default those
        of the record.
    noise
        A noise model ("gaussian", "student_t", "quantised" or "correlated"); or several, or "auto" for all, from which
        the most probable one is chosen. Gaussian noise, if it is among them, is replaced only by a model whose log
        evidence is clearly larger (at least 5 nats), and never by correlated noise.

    Returns
    -------
    ModelComparison or Verdict
        A verdict if there is nothing to compare. Its grade is `no_free_decay` if the signal is not the free decay of
        one oscillator, and `not_weighed` if no model can be fitted (the sentence gives the reason, and no Refusal is
        raised).

    Raises
    ------
    InputError
        If an argument is invalid, or a restoring law does not suit the unit of the signal.
    """
    for law in restoring:
        check_translation(signal.unit, law, signal.name)
    if (other := no_free_decay(signal)) is not None:
        return other
    try:
        return compare_signal(
            signal,
            damping=damping,
            restoring=restoring,
            known=known,
            priors=priors,
            reference=reference,
            approximate=deviation != "none",
            noises=noises_of(noise),
        )
    except Refusal as refusal:
        text = str(refusal)
        sentence = f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}"
        verdict = Verdict(signal.name, Grade.NOT_WEIGHED, False, "", float("nan"), quantity=signal.quantity)
        return replace(verdict, sentence=sentence)


def answer(
    signal: Signal,
    comparison: ModelComparison | Verdict,
    amplitudes: Sequence[float] | None = None,
    *,
    unit: Unit | None = None,
    sensor: float = SENSOR,
    measured: bool = True,
    seed: int = 0,
    notes: Sequence[str] = (),
    sample: bool = True,
    repeated: bool = False,
) -> Answer:
    """Conclude from a comparison which damping a signal has, how large it is, and how well the damping law holds.

    Parameters
    ----------
    signal
        The signal.
    comparison
        The result of `compare_models` for this signal.
    amplitudes
        Amplitudes at which to give the damping ratio, in `unit`; by default three, at 10, 50 and 90 % of the
        logarithmic range of the record. They may be outside this range by the factor `BEYOND`.
    unit
        Unit of `amplitudes`; by default `signal.unit`, which is also used for a unit of velocity or acceleration (rpm,
        g). The answer itself is always in `signal.unit` (rad, m or the sensor's unit) and s.
    sensor
        Relative linearity error of the sensor (sd; 0.002 by default), which is added in quadrature to the error of
        damping ratios, unless these are measured without a law, or the comparison assumes exact laws.
    measured
        Whether the record is a measurement. The probabilities of dampings and of the restoring law in the verdict are
        then at most `thresholds.CAP`, unless the comparison assumes exact laws.
    seed
        Seed of all random numbers.
    notes
        Sentences on the record that are added to the remarks.
    sample
        Whether to sample the posteriors of the most probable models with the full equation of motion. If False, the
        answer is from linear approximations of the motion.
    repeated
        Whether the signal is one of several records of a specimen (the object that was recorded). The answer then
        contains each model's likelihood (for `Answer.of_specimen`).

    Returns
    -------
    Answer
        If `comparison` is a verdict, or if no damping law fits and the signal is rather an oscillation of another kind
        (grade `no_free_decay`), the answer contains only the verdict. It is also of another kind if two oscillations of
        close frequencies explain the signal far better than the best law.

    Raises
    ------
    InputError
        If an amplitude is outside the range of the record by more than `BEYOND`.
    """
    if isinstance(comparison, Verdict):
        return Answer(AnswerContent(comparison.to_dict()))
    wanted = amplitudes_in_base_unit(amplitudes, comparison, unit or UNITS[signal.unit])
    if sample:
        comparison = with_samples(comparison, seed)
    findings = compute_findings(comparison, wanted, sensor=sensor, seed=seed)
    first = signal.provenance.start
    averaging = comparison.averaging
    unused = other_decays(signal.provenance.decays, first, first + float(signal.t[-1] - signal.t[0]))
    # Nats of log likelihood that the best law lacks. Search for two close modes only if they can be this far ahead.
    lacking = 0.5 * signal.t.size * (findings.unexplained / max(findings.noise, 1e-12)) ** 2
    # Specified values that are slightly wrong also leave much unexplained.
    best = comparison.best
    names = {*LAWS.get(best.candidate.restoring).parameters, *START}
    specified = sorted(names & best.fit.parameters.known.keys())
    search = lacking > NATS_AHEAD and not specified
    unexplained = findings.unexplained * comparison.data.recorded_amplitude if search else 0.0
    noise, phase = _noise_remark(comparison.noise), _phase_remark(comparison.data, first)
    remarks = [*notes, *filter(None, (remark_on(signal, unexplained), noise, phase, unused))]
    clear = {r.candidate.damping for r in comparison.results}
    clear |= {c.damping for c, why in comparison.refused.items() if why == FAR_BEHIND}
    reasons = {c.damping: why for c, why in comparison.refused.items() if c.damping not in clear}
    remarks += [f"{'+'.join(terms)} was not compared: {why}." for terms, why in reasons.items()]
    try:
        curve = law_free(signal)
    except Refusal:  # for example because the record is too short
        curve = None
    measured_ratios = None
    if curve is not None and findings.ratios:
        measured_ratios = curve.at(curve.times_of(np.array([r.amplitude for r in findings.ratios])))
    verdict = decide(
        findings,
        record=signal.name,
        unit=signal.unit,
        quantity=signal.quantity,
        measured=measured,
        approximate=comparison.approximate,
        window=UsedWindow(first, first + comparison.data.duration, comparison.data.cycles, ""),
        notes=remarks,
        averages=None if averaging is None else Averages(averaging.cycles, averaging.error),
        law_free=measured_ratios,
    )
    no_law_fits = verdict.law_free and findings.unexplained >= thresholds.REMARK
    if no_law_fits and specified:
        text = f"No law fits with the specified {', '.join(specified)}; one may fit if it is inferred."
        verdict = replace(verdict, remarks=(text, *verdict.remarks))
    no_law_fits = no_law_fits and not specified
    other = no_free_decay(signal, no_law_fits, unexplained) if no_law_fits or unexplained else None
    if other is not None:
        return Answer(AnswerContent(other.to_dict()))
    arrays = dict(picture(comparison, findings))
    if verdict.law_free:
        left_out = OF_LAW if verdict.contradicted else BY_LAW
        arrays = {n: a for n, a in arrays.items() if not n.startswith(left_out)}
    if curve is not None:
        arrays |= measured_curve(curve)
    if repeated:
        arrays |= _runs(comparison, findings)
    return _store(comparison, verdict, arrays)


def _store(comparison: ModelComparison, verdict: Verdict, arrays: Mapping[str, np.ndarray]) -> Answer:
    """Return an answer in its stored form, from a model comparison, its verdict and the arrays of its figure."""
    further: dict[str, np.ndarray] = {}
    priors, posteriors, laws = [], [], []
    for r in comparison.results:
        name = damping, law = "+".join(r.candidate.damping), r.candidate.restoring
        described = {n: p.describe() for n, p in r.fit.parameters.priors.items()}
        priors.append(CandidatePriors(*name, described))
        if r.sampled is not None and not r.sampled.doubt:
            table, further[f"draws/{damping}@{law}"] = posterior_of(comparison, r, r.sampled)
            posteriors.append(SampledPosterior(*name, **table))
        if r.linearisation is not None and r.approximate_posterior is not None:
            laws.append(StoredFit(*name, split(state_of(comparison, r), further, law_prefix(*name))))
    compared = [_row(comparison, r) for r in comparison.results if comparison.compares(r)]
    reasons = (("+".join(c.damping), c.restoring, why) for c, why in comparison.refused.items())
    refused = [ComparedCandidate(damping, law, outcome=why) for damping, law, why in reasons]
    rivals = [r for r in comparison.forms if comparison.compares(r)]
    content = AnswerContent(
        verdict.to_dict(),
        candidates=(*compared, *refused),
        priors=tuple(priors),
        posteriors=tuple(posteriors),
        laws=tuple(laws),
        rivals=tuple(
            replace(_row(comparison, r), place="+".join(replaced_sum(r.candidate.damping))) for r in rivals
        ),
        noise=comparison.noise.name,
        noises=tuple(NoiseEvidence(n.name, n.log_evidence) for n in comparison.noise.weighed),
        epsilon=None if comparison.epsilon_known else comparison.epsilon,
    )
    return Answer(content, arrays, further)


def measured_curve(fit: LawFree) -> dict[str, np.ndarray]:
    """Return the damping against amplitude, measured without assuming a damping law, as arrays `free/...` for a figure.

    `free/amplitude` contains `CURVE_POINTS` falling amplitudes in the record's base unit. At these, `free/ratio` is the
    equivalent damping ratio, and `free/lost` is the energy lost in a cycle per unit of inertia (unit²/s²). The arrays
    `free/ratio_low`, `free/ratio_high`, `free/lost_low` and `free/lost_high` are the ends of their 95 % intervals. The
    energy lost in a cycle is 4π ζ E, with the damping ratio ζ and the energy E of the oscillation.
    """
    at = fit.at(np.linspace(*fit.span, CURVE_POINTS))
    order, half = np.argsort(-at.amplitude), NORMAL_95 * at.ratio_sd
    lost = 4 * np.pi * at.energy
    arrays = {"free/amplitude": at.amplitude[order]}
    for end, values in (("", at.ratio), ("_low", at.ratio - half), ("_high", at.ratio + half)):
        arrays |= {f"free/ratio{end}": values[order], f"free/lost{end}": (lost * values)[order]}
    return arrays


def amplitudes_in_base_unit(
    amplitudes: Sequence[float] | None, comparison: ModelComparison, unit: Unit
) -> tuple[float, ...] | None:
    """Convert amplitudes to the base unit of a record, and check that they are in or near the record's range.

    Parameters
    ----------
    amplitudes
        The amplitudes in `unit`, or None.
    comparison
        The model comparison on the record; only the record's first and last amplitude are used.
    unit
        The unit of the recorded file. For a unit of velocity or acceleration, `amplitudes` are in its base unit.

    Returns
    -------
    tuple or None
        The amplitudes in the base unit (rad, m or the sensor's unit); None if `amplitudes` is None.

    Raises
    ------
    InputError
        If there are no amplitudes, or one is above the record's first amplitude, or below its last, by more than the
        factor `BEYOND`.
    """
    if amplitudes is None:
        return None
    if len(amplitudes) == 0:
        raise InputError("no amplitudes; give at least one, or leave them out")
    own = unit.displacement
    high, low = (a * own.scale for a in (comparison.data.amplitude, comparison.data.final_amplitude))
    for a in amplitudes:
        if not low / BEYOND <= a <= high * BEYOND:
            raise InputError(
                f"amplitude {digits(a)} {own.name}: the amplitudes of the record are {digits(low, n=3)} to "
                f"{digits(high, n=3)} {own.name}; give one in this range"
            )
    return tuple(float(a) * own.factor for a in amplitudes)


def _noise_remark(noise: SampleNoise) -> str:
    """Return a sentence on a noise model other than Gaussian noise; an empty text for Gaussian noise.

    The sentence says by how many nats the model's log evidence is larger than that of Gaussian noise, or, if the two
    were not compared, that the model was specified.
    """
    if noise.name == GAUSSIAN:
        return ""
    if np.isnan(noise.ahead):
        return f"The noise model is {noise.name}, as specified."
    nats = f"{fixed_decimals(noise.ahead, 0)} nats" if np.isfinite(noise.ahead) else "far"
    ahead = f"is {nats} ahead of Gaussian noise in log evidence"
    match noise.name:
        case "student_t":
            freedom = digits(noise.fitted.values["noise_dof"], n=2)
            what = f"Student's t noise (student_t, {freedom} degrees of freedom)"
            return f"Outliers are given little weight: {what} {ahead}."
        case "quantised":
            return (
                f"The record is rounded to coarse steps, which the noise model includes: quantised {ahead}."
            )
        case _:
            return f"The noise model is {noise.name}, which {ahead}."


def _phase_remark(data: Data, first: float) -> str:
    """Return sentences on a phase of the oscillation that wanders randomly, and on gaps whose cycles cannot be counted.

    `first` is the time of the first sample in s, on the record's own time axis. The text is empty if the phase does not
    wander and there are no such gaps.
    """
    averaged, sentences = data.averaged, []
    if averaged is not None and averaged.wander:
        sentences.append(
            f"The phase wanders like a random walk, by {digits(averaged.wander, n=2)} rad (one sd) until the end; the "
            "intervals allow for it."
        )
    if averaged is not None and averaged.jumps:
        at = ", ".join(f"{digits(first + t)} s" for t in averaged.jumps)
        where = "gap" if len(averaged.jumps) == 1 else "gaps"
        sentences.append(f"The cycles in the {where} at {at} cannot be counted; the phase may jump there.")
    return " ".join(sentences)


def _runs(comparison: ModelComparison, findings: Findings) -> dict[str, np.ndarray]:
    """Return the arrays that a verdict on several records of a specimen needs.

    `run/DAMPING@RESTORING/...`: each model's likelihood as a function of its damping (which models: see `JOINABLE`).
    `over`, `over_sd`: the deviation of the damping from its law at each amplitude of the damping curve (see `CURVE`);
    missing if the laws were assumed to hold exactly.
    `run/reference`: the amplitude and the angular frequency to which default priors are scaled.
    """
    amplitudes = np.array([r.amplitude for r in findings.curve])
    arrays = {f"{RUN}reference": np.array([comparison.reference.amplitude, comparison.reference.frequency])}
    if findings.over_curve:
        arrays["over"], arrays["over_sd"] = map(np.array, zip(*findings.over_curve, strict=True))
    compared = [r for r in (*comparison.results, *comparison.forms) if comparison.compares(r)]
    top = max(r.log_evidence for r in compared)
    for r in compared:
        needed = r in comparison.results or r.log_evidence > top - JOINABLE
        if needed and (run := ratio_likelihood(r, amplitudes)) is not None:
            split(run, arrays, f"{RUN}{'+'.join(r.candidate.damping)}@{r.candidate.restoring}")
    return arrays


def _row(comparison: ModelComparison, result: CandidateResult) -> ComparedCandidate:
    """Convert the result of one damping model to the form in which it is stored.

    The log evidence with deviations is None if the laws were assumed to hold exactly. The rms residual is None if
    averages over cycles were fitted instead of the samples of the record.
    """
    data, noise = comparison.data, comparison.variance / comparison.inflation
    approximate = result.approximate_posterior is not None
    # The fit uses means of `thinned` samples. Add the noise that averaging removed, to get the residual of the samples.
    squares = result.fit.squares / result.fit.residual.size + (data.thinned - 1) * noise
    return ComparedCandidate(
        damping="+".join(result.candidate.damping),
        restoring=result.candidate.restoring,
        log_evidence=result.log_evidence if approximate else None,
        log_evidence_exact=result.exact_posterior.log_evidence if approximate else result.log_evidence,
        rms=None if data.averaged is not None else float(np.sqrt(squares)),
        parameters=result.fit.parameters.damping_names,
    )
