"""The answer on one signal, as a study's task, the command line and Python get it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from bayesdamp.config.sections import DEVIATIONS
from bayesdamp.inference.deviation.findings import SENSOR, Findings, findings, posterior_of
from bayesdamp.inference.deviation.gaussian.linear import DampingLikelihood
from bayesdamp.inference.deviation.numbers.rivals import place_of
from bayesdamp.inference.deviation.picture import picture
from bayesdamp.inference.deviation.quick import weighing_of
from bayesdamp.inference.deviation.sample_noise import GAUSSIAN, SampleNoise, noises_of
from bayesdamp.inference.deviation.sampling import with_samples
from bayesdamp.inference.deviation.single import found_of
from bayesdamp.inference.deviation.specimen import DampingRun, OtherForm, WeighedRun, damping_run
from bayesdamp.inference.deviation.weighing import Known, Result, Weighing
from bayesdamp.interface.no_free_decay import no_free_decay, remark_on
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import Prior
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.oscillation.law_free import TWO_SIDED, amplitude_curves, law_free
from bayesdamp.serial import split
from bayesdamp.store.contents import (
    AnswerContent,
    WeighedCandidate,
)
from bayesdamp.types import OK, InputError, Reference, Refusal, Signal
from bayesdamp.units import UNITS, Unit
from bayesdamp.verdict.decide import decide
from bayesdamp.verdict.parts import Averages, DampingRatio, FrequencyAt, Grade, LawFreeAt, Window
from bayesdamp.verdict.specimen import Answered
from bayesdamp.verdict.types import Verdict

BEYOND = 1.3
"""By which factor an amplitude that is asked for may lie outside those of the record."""
WEIGHED = "weighing"
CURVE = ("amplitude", "ratio", "low", "high", "over", "over_sd")
BY_LAW = ("ratio", "low", "high", "free/")
"""How arrays of a picture begin that are the damping curve by the law that is the answer, not measured without one."""
OF_LAW = (*BY_LAW, "fit", "residual", "exponent", "law/", "work/")
"""How all those begin that the law has a part in."""
RUN = "run/"
"""Before the names of arrays that hold a candidate's likelihood of its damping, for a verdict on several records."""
JOINABLE = 40.0
"""Nats behind the best up to which it is kept of a form that is not compared."""


@dataclass(frozen=True)
class Answer:
    """The answer on a record, as a cell or a file holds it.

    arrays: what its picture is drawn from, as `inference.deviation.picture` leaves them, and of one of several records
    `run/DAMPING@RESTORING/...`. further: draws of the candidates that were sampled, `draws/DAMPING@RESTORING`, and
    arrays of the laws of `content`, `found/DAMPING@RESTORING/...`.
    """

    content: AnswerContent
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    further: Mapping[str, np.ndarray] = field(default_factory=dict)

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict."""
        return Verdict.from_dict(self.content.verdict)

    @property
    def candidates(self) -> tuple[WeighedCandidate, ...]:
        """Each that was asked for, in the order of the question, refused ones last."""
        return self.content.candidates

    @property
    def rivals(self) -> tuple[WeighedCandidate, ...]:
        """Other forms of damping that were weighed."""
        return self.content.rivals

    def of_specimen(self) -> Answered:
        """Return what a verdict on several records takes of this one."""
        rows = [r for r in self.candidates if r.outcome == OK]
        exact = any(r.log_evidence is None for r in rows)

        def log_of(row: WeighedCandidate) -> float:
            return row.exact if exact or row.log_evidence is None else row.log_evidence

        top = max(map(log_of, rows))
        curve = {name: self.arrays[name] for name in CURVE if name in self.arrays}
        runs = {
            (r.damping, r.restoring): run
            for r in (*rows, *self.rivals)
            if (run := _run_from(f"{RUN}{r.damping}@{r.restoring}/", r.parameters, self.arrays, top))
            is not None
        }
        weighed = WeighedRun(
            {(r.damping, r.restoring): log_of(r) - top for r in rows},
            tuple(OtherForm(r.damping, r.restoring, log_of(r) - top, r.place) for r in self.rivals),
            runs,
            Reference(*map(float, self.arrays.get(f"{RUN}reference", (1.0, 1.0)))),
            self.arrays["amplitude"],
        )
        return Answered(self.verdict, weighed, curve)


def _of_verdict(verdict: Verdict) -> Answer:
    return Answer(AnswerContent(verdict.to_dict()))


def found_name(damping: str, restoring: str) -> str:
    """How the arrays of a law begin, as they are in `Answer.further`."""
    return f"found/{damping}@{restoring}"


def answer(
    signal: Signal,
    amplitudes: Sequence[float] | None = None,
    *,
    unit: Unit | None = None,
    deviation: str = "auto",
    damping: Sequence[str] = (),
    restoring: Sequence[str] = (),
    known: Known | None = None,
    priors: Mapping[str, Prior] | None = None,
    reference: Reference | None = None,
    sensor: float = SENSOR,
    measured: bool = True,
    seed: int = 0,
    notes: Sequence[str] = (),
    sample: bool = True,
    made: dict[str, Weighing] | None = None,
    repeated: bool = False,
    noise: str | Sequence[str] = "auto",
) -> Answer:
    """Which damping a signal has, how large it is and how well the law holds.

    amplitudes: where the damping ratio is given, in `unit` (of the displacement; by default the signal's); three of the
    record by default. What comes back is in the signal's. deviation: "none", laws
    hold exactly; "law" or "auto", they may hold approximately. known: values of parameters, or a function from a law's
    name to them; priors: by parameter. sensor: relative linearity of the sensor, the floor of every rate. measured:
    whether probabilities are capped. notes: sentences on the record, for the remarks. sample: whether motions
    themselves are sampled, and not their linear model alone. made: where the weighing under linear models is left, and
    taken from where it is there: of the same signal and arguments. repeated: whether it is one of several records of a
    specimen, for whose verdict each candidate's likelihood of its damping is kept. noise: a noise model, several to
    choose from, or "auto". Of a signal on which nothing can be
    said the grade is `not_weighed` and the sentence says why; of one that is no free decay of one oscillator it is
    `no_free_decay`, and nothing is weighed.
    """
    if deviation not in DEVIATIONS:
        raise InputError(f"deviation = {deviation!r}: must be one of {', '.join(DEVIATIONS)}")
    wrong = [n for n in restoring if signal.unit != "rad" and not LAWS.get(n).translates]
    if wrong:
        raise InputError(
            f"restoring law {wrong[0]!r} describes an angle, and {signal.name} is in {signal.unit}"
        )
    other = no_free_decay(signal)
    if other is not None:
        return _of_verdict(other)
    approximate = deviation != "none"
    try:
        weighing = (made or {}).get(WEIGHED) or weighing_of(
            signal,
            damping=damping,
            restoring=restoring,
            known=known,
            priors=priors,
            reference=reference,
            approximate=approximate,
            noises=noises_of(noise),
        )
    except Refusal as refusal:
        text = str(refusal)
        said = f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}"
        none = Verdict(signal.name, Grade.NOT_WEIGHED, False, "", float("nan"), quantity=signal.quantity)
        return _of_verdict(replace(none, sentence=said))
    if made is not None:
        made[WEIGHED] = weighing
    asked = in_base(amplitudes, weighing, unit or UNITS[signal.unit])
    if sample:
        weighing = with_samples(weighing, approximate, seed)
    found = findings(weighing, asked, approximate=approximate, sensor=sensor, seed=seed)
    first = signal.provenance.start
    window = Window(first, first + weighing.data.duration, weighing.data.cycles, "")
    averaging = weighing.averaging
    averages = None if averaging is None else Averages(averaging.cycles, averaging.error)
    verdict = decide(
        found,
        record=signal.name,
        unit=signal.unit,
        quantity=signal.quantity,
        measured=measured,
        approximate=approximate,
        window=window,
        notes=[
            *notes,
            *filter(None, [remark_on(signal), _on_noise(weighing.noise)]),
            *(_not_weighed(weighing) if damping else ()),
        ],
        averages=averages,
        law_free=measured_at(signal, [r.amplitude for r in found.ratios]) if found.ratios else None,
    )
    other = no_free_decay(signal, harmonics=True) if verdict.law_free else None
    if other is not None:
        return _of_verdict(other)
    arrays = dict(picture(weighing, found))
    if verdict.law_free:
        left_out = OF_LAW if verdict.contradicted else BY_LAW
        arrays = {n: a for n, a in arrays.items() if not n.startswith(left_out)} | measured_curve(signal)
    if repeated:
        arrays |= _runs(weighing, found, approximate)
    return _stored(weighing, verdict, arrays)


def _stored(weighing: Weighing, verdict: Verdict, arrays: Mapping[str, np.ndarray]) -> Answer:
    """Return the answer as cells and files hold it."""
    further: dict[str, np.ndarray] = {}
    terms = next(iter(weighing.solvers.values())).terms
    priors, posteriors, laws, fits = [], [], [], {}
    for r in weighing.results:
        law = r.candidate.restoring
        name = {"damping": "+".join(r.candidate.damping), "restoring": law}
        priors.append({**name, "priors": {n: p.describe() for n, p in r.fit.parameters.priors.items()}})
        if set(r.candidate.damping) == set(
            terms
        ):  # the fit of all terms, of a law that was not out of the question
            fits[law] = r.fit.parameters.named(r.fit.z)
        if r.sampled is not None and r.sampled.trusted:
            said, draws = posterior_of(weighing, r, r.sampled)
            further["draws/{damping}@{restoring}".format(**name)] = draws
            posteriors.append({**name, **said})
        if r.about is not None and r.weighed is not None:
            laws.append({**name, "found": split(found_of(weighing, r), further, found_name(**name))})
    refused = [
        WeighedCandidate("+".join(c.damping), c.restoring, outcome=why) for c, why in weighing.refused.items()
    ]
    rivals = [r for r in weighing.forms if _counts(weighing, r)]
    content = {
        "verdict": verdict.to_dict(),
        "candidates": [*(_row(r) for r in weighing.results if _counts(weighing, r)), *refused],
        "rivals": [replace(_row(r), place="+".join(place_of(r.candidate.damping))) for r in rivals],
        "fits": fits,
        "priors": priors,
        "posteriors": posteriors,
        "laws": laws,
        "noise": weighing.noise.name,
        "noises": weighing.noise.weighed,
        "terms": terms,
        "epsilon": None if weighing.epsilon_known else weighing.epsilon,
        "frictions": weighing.frictions,
    }
    return Answer(AnswerContent.of_meta(split(content)), arrays, further)


def measured_at(signal: Signal, amplitudes: Sequence[float]) -> LawFreeAt | None:
    """Return what is measured without a law at amplitudes (rad or m); None where the record is too short for it."""
    try:
        curve = law_free(signal, features(signal))
    except Refusal:
        return None
    at = curve.at(curve.times_of(np.array(amplitudes)))
    half = TWO_SIDED * at.ratio_sd
    columns = np.column_stack([at.amplitude, at.ratio, at.ratio_sd, at.ratio - half, at.ratio + half])
    ratios = tuple(
        DampingRatio(a, signal.unit, r, sd, 0.0, low, high) for a, r, sd, low, high in columns.tolist()
    )
    value, half = (float(v[-1]) / (2 * np.pi) for v in (at.frequency, TWO_SIDED * at.frequency_sd))
    frequency = FrequencyAt(float(at.amplitude[-1]), signal.unit, value, value - half, value + half)
    return LawFreeAt(ratios, frequency)


def measured_curve(signal: Signal) -> dict[str, np.ndarray]:
    """Return the arrays `free/*` of a picture, the damping curve without a law, as they are measured.

    The energy lost in a cycle is that of a nearly sinusoidal oscillation.
    """
    at = amplitude_curves(signal, features(signal))
    order, half = np.argsort(at.amplitude), TWO_SIDED * at.ratio_sd
    lost = 2 * np.pi * (at.frequency * at.amplitude) ** 2
    arrays = {"free/amplitude": at.amplitude[order]}
    for end, values in (("", at.ratio), ("_low", at.ratio - half), ("_high", at.ratio + half)):
        arrays |= {f"free/ratio{end}": values[order], f"free/lost{end}": (lost * values)[order]}
    return arrays


def in_base(amplitudes: Sequence[float] | None, weighing: Weighing, unit: Unit) -> tuple[float, ...] | None:
    """Amplitudes in a unit of displacement as the weighing has them, in its base; None where none are given. Raises
    InputError for one that the record does not have."""
    if amplitudes is None:
        return None
    own = unit.displacement
    high, low = (a * own.scale for a in (weighing.data.amplitude, weighing.data.final_amplitude))
    for a in amplitudes:
        if not low / BEYOND <= a <= high * BEYOND:
            raise InputError(
                f"amplitude {a:g} {own.name}: the record has {low:.3g} to {high:.3g} {own.name}; give one of these"
            )
    return tuple(float(a) * own.factor for a in amplitudes)


def _on_noise(noise: SampleNoise) -> str:
    """Return a sentence on noise that is not Gaussian, "" on noise that is."""
    if noise.name == GAUSSIAN:
        return ""
    if not np.isfinite(noise.ahead):
        return f"The noise model is {noise.name}, as specified."
    ahead = f"is {noise.ahead:.0f} nats ahead of Gaussian noise"
    match noise.name:
        case "student_t":
            freedom = f"{noise.fitted.values['noise_dof']:.2g} degrees of freedom"
            return f"The record has outliers, which count for little: Student's t noise (student_t, {freedom}) {ahead}."
        case "quantised":
            return f"The record is rounded to coarse steps, which is allowed for: rounded noise (quantised) {ahead}."
        case _:
            return f"The noise model is {noise.name}, which {ahead}."


def _not_weighed(weighing: Weighing) -> list[str]:
    """A sentence for each sum that was named and is weighed under no law."""
    weighed = {r.candidate.damping for r in weighing.results}
    why = {c.damping: said for c, said in weighing.refused.items() if c.damping not in weighed}
    return [f"{'+'.join(terms)} was not weighed: {said}." for terms, said in why.items()]


def _runs(weighing: Weighing, found: Findings, approximate: bool) -> dict[str, np.ndarray]:
    """What a verdict on several records takes of this one: of each candidate the likelihood of its damping, and how far
    the damping is off its law along the curve."""
    amplitudes = np.array([r.amplitude for r in found.curve])
    arrays = {f"{RUN}reference": np.array([weighing.reference.amplitude, weighing.reference.frequency])}
    if found.over_curve:
        arrays |= {
            n: np.array(c)
            for n, c in zip(("over", "over_sd"), zip(*found.over_curve, strict=True), strict=True)
        }
    every = [r for r in (*weighing.results, *weighing.forms) if _counts(weighing, r)]
    top = max(r.log_evidence for r in every)
    for r in every:
        counts = r in weighing.results or r.log_evidence > top - JOINABLE
        run = damping_run(weighing, r, amplitudes, approximate) if counts else None
        if run is None:
            continue
        own = {n: getattr(run, n) for n in ("coefficients", "mode", "per_unit", "growth")}
        name = f"{RUN}{'+'.join(r.candidate.damping)}@{r.candidate.restoring}"
        arrays |= {
            f"{name}/{part}": np.asarray(values, float)
            for part, values in (own | vars(run.likelihood)).items()
        }
    return arrays


def _run_from(
    prefix: str, names: tuple[str, ...], arrays: Mapping[str, np.ndarray], top: float
) -> DampingRun | None:
    """A candidate's likelihood as `_runs` left it, less so many nats; None where it was not kept."""
    if f"{prefix}log" not in arrays:
        return None
    of = {n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)}
    likelihood = DampingLikelihood(of["log"] - top, of["slope"], of["information"])
    return DampingRun(
        names, of["coefficients"].astype(bool), of["mode"], likelihood, of["per_unit"], of["growth"]
    )


def _counts(weighing: Weighing, result: Result) -> bool:
    """Whether a candidate is compared: under approximate laws those that could be linearised."""
    return weighing.results[0].weighed is None or result.weighed is not None


def _row(result: Result) -> WeighedCandidate:
    return WeighedCandidate(
        damping="+".join(result.candidate.damping),
        restoring=result.candidate.restoring,
        log_evidence=None if result.weighed is None else result.log_evidence,
        log_evidence_exact=(
            result.log_evidence if result.weighed is None else result.exact_weighed.log_evidence
        ),
        rms=float((result.fit.squares / result.fit.residual.size) ** 0.5),
        parameters=result.fit.parameters.damping_names,
    )
