"""One candidate (a damping sum under a restoring law) on one record: what its tasks read from study and store."""

from dataclasses import replace
from functools import cached_property

from bayesdamp.config import SignalSpec, Study
from bayesdamp.inference.deviation.single import rebuild_single
from bayesdamp.inference.mode import StoredMode, restore_mode
from bayesdamp.inference.model.target import default_prior
from bayesdamp.interface.fit import Fit
from bayesdamp.interface.model import NOT_INFERRED, Case, Model
from bayesdamp.physics.damping import parse_model
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.pipeline.answering import ANSWER, stored_fit
from bayesdamp.pipeline.records import StudyRecord
from bayesdamp.serial import join
from bayesdamp.store.results import AnswerContent, ModeContent, Store
from bayesdamp.types import OK, InputError, Problem, Refusal, following


class StudyCandidate:
    """One candidate (a damping sum under a restoring law) on one record, with the inputs of its tasks.

    model: name of the candidate. damping, terms, restoring: its damping sum, the terms of the sum, and its restoring
    law. repeat: number of the repeat of a simulated signal, from 0. path: `SIGNAL/REPEAT/CANDIDATE`, the part of a
    task's name that all its tasks have.
    """

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, model: str, store: Store) -> None:
        self.study, self.spec, self.repeat, self.model, self.store = study, spec, repeat, model, store
        self.record = StudyRecord(study, spec, repeat, store)
        self.damping, self.restoring = spec.parts(model)
        self.terms = parse_model(self.damping)
        self.path = f"{self.record.name}/{model}"

    @property
    def methods(self) -> tuple[str, ...]:
        """The names of the estimators that the study applies to this candidate and repeat; () for none."""
        on = self.study.estimators.on(self.repeat)
        return on if self.model in self.study.estimate(self.spec) else ()

    @property
    def problem(self) -> Problem:
        """The candidate's damping terms, and what is known of its system, as the argument of an estimator."""
        return Problem(self.terms, self.record.system(self.restoring))

    def specify(self, deviation: str) -> Model:
        """Return the candidate as a `Model` of the public interface, with the study's priors and known values.

        `deviation` is "none" for exact laws, or "law" for deviations from them. Raises Refusal if a setting of the
        study is not possible for such a model.
        """
        study, record, system = self.study, self.record, self.record.system(self.restoring)
        scales, sensor = record.content.scales, study.posterior.sensor
        model = Model(self.damping, self.restoring, study.noises, deviation=deviation, sensor=sensor)
        priors = {n: p for n, p in study.priors.items() if n in model.parameters}
        free = {n: p for n, p in system.free.items() if n in model.parameters}
        if "epsilon" in free:  # a model infers ε only with a stated prior
            default = default_prior(
                "epsilon", Oscillator(self.terms, self.restoring), study.noises[0], scales, record.features
            )
            free["epsilon"] = free["epsilon"] or default
        fixed = NOT_INFERRED if model.approximate else ()
        try:
            return replace(
                model,
                priors={n: p for n, p in {**priors, **free}.items() if p is not None and n not in fixed},
                known={n: v for n, v in system.known.items() if n in model.parameters},
                amplitude=scales.amplitude,
                frequency=scales.frequency,
            )
        except InputError as error:
            raise Refusal(str(error)) from None

    @cached_property
    def case(self) -> Case:
        """The candidate on the record, under exact laws: signal, model, features and the scales of default priors."""
        record = self.record
        return Case(record.signal, self.specify("none"), record.features, record.content.scales)

    @cached_property
    def answer(self) -> AnswerContent | None:
        """The answer by linear approximations on the record; None if there is none, or if it compared no candidate."""
        answer = AnswerContent.maybe(self.record.find(ANSWER))
        return answer if answer is not None and answer.candidates else None

    @property
    def noise(self) -> str:
        """Name of the noise model with the largest evidence in the linear answer, of those that the study allows.

        If the answer compared none of these, the first one that the study allows.
        """
        compared = self.answer.noises if self.answer else ()
        allowed = [noise for noise in compared if noise.name in self.study.noises]
        return max(allowed, key=lambda n: n.log_evidence).name if allowed else self.study.noises[0]

    @property
    def epsilon(self) -> float | None:
        """The velocity ε (rad/s or m/s) within which friction changes its sign, as the answer on the record assumes.

        None if ε is inferred or was given, or if there is no answer.
        """
        inferred = "epsilon" in self.spec.under(self.restoring).free
        return self.answer.epsilon if self.answer and not inferred else None

    @cached_property
    def fit(self) -> Fit:
        """The fit that samplers and evidence methods use.

        Under exact laws it is at the stored posterior mode. If the study allows deviations from the laws, it is the fit
        that the answer on the record has stored. Raises Refusal if there is no fit.
        """
        signal = self.record.signal
        if self.study.likelihood == "law":
            stored = stored_fit(self.record, self.damping, self.restoring)
            return Fit.at_law(signal, self.specify("law"), rebuild_single(signal, self.restoring, stored))
        result = self.store.read(f"mode/{self.path}")
        if result.outcome != OK:
            raise Refusal(following(result.name, result.outcome))
        stored_mode = join(StoredMode, ModeContent.of(result).stored, result.arrays, "stored")
        mode = restore_mode(self.case.target(self.noise, self.epsilon), stored_mode)
        return Fit.at_mode(signal, self.case.model, mode)
