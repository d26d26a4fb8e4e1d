"""Read what the tasks on one candidate need from the study and the store.

A candidate is a sum of damping terms under a restoring law.
"""

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
    """One candidate (a sum of damping terms under a restoring law) on one record, with the inputs of its tasks.

    model: name of the candidate. damping, terms, restoring: name of its damping sum, names of the terms of the sum, and
    name of its restoring law. repeat: number of the repeat of a simulated signal, from 0. path:
    `SIGNAL/REPEAT/CANDIDATE`, which is part of the names of all its tasks.
    """

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, model: str, store: Store) -> None:
        self.study, self.spec, self.repeat, self.model, self.store = study, spec, repeat, model, store
        self.record = StudyRecord(study, spec, repeat, store)
        self.damping, self.restoring = spec.parts(model)
        self.terms = parse_model(self.damping)
        self.path = f"{self.record.name}/{model}"

    @property
    def methods(self) -> tuple[str, ...]:
        """Names of the estimators that the study applies to this candidate on this repeat of the record, if any."""
        return self.study.estimators.on(self.repeat) if self.model in self.study.estimate(self.spec) else ()

    @property
    def problem(self) -> Problem:
        """The input of an estimator: the damping terms, and the known values and priors of the oscillator."""
        return Problem(self.terms, self.record.system(self.restoring))

    def specify(self, deviation: str) -> Model:
        """Return the candidate as a `Model` of the public interface, with the study's priors and known values.

        deviation: "none" if the laws hold exactly, "law" if the model allows deviations from them. Raises Refusal if a
        setting of the study is not possible for such a model.
        """
        study, record, system = self.study, self.record, self.record.system(self.restoring)
        scales, sensor = record.content.scales, study.posterior.sensor
        model = Model(self.damping, self.restoring, study.noises, deviation=deviation, sensor=sensor)
        priors = {n: p for n, p in study.priors.items() if n in model.parameters}
        free = {n: p for n, p in system.free.items() if n in model.parameters}
        if "epsilon" in free:  # a model infers ε only with a stated prior
            osc = Oscillator(self.terms, self.restoring)
            default = default_prior("epsilon", osc, study.noises[0], scales, record.features)
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
        """The record with the candidate as a model with exact laws, the features, and the scales of default priors."""
        record = self.record
        return Case(record.signal, self.specify("none"), record.features, record.content.scales)

    @cached_property
    def answer(self) -> AnswerContent | None:
        """The stored model comparison by linear approximations on the record (the content of the task `ANSWER`).

        None if it is missing, or if it compared no candidate.
        """
        answer = AnswerContent.maybe(self.record.find(ANSWER))
        return answer if answer is not None and answer.candidates else None

    @property
    def noise(self) -> str:
        """Name of the noise model, the same for all candidates on this record: the most probable that the study allows.

        The evidences of the noise models were computed by the task `ANSWER`, which compares the damping models on the
        record. If it compared none of the allowed noise models, or has no result, the name is that of the first allowed
        noise model.
        """
        compared = self.answer.noises if self.answer else ()
        allowed = [noise for noise in compared if noise.name in self.study.noises]
        return max(allowed, key=lambda n: n.log_evidence).name if allowed else self.study.noises[0]

    @property
    def epsilon(self) -> float | None:
        """The velocity ε (rad/s or m/s) within which Coulomb friction changes its sign, from the answer on the record.

        None if ε is inferred or was given, or if there is no answer.
        """
        inferred = "epsilon" in self.spec.under(self.restoring).free
        return self.answer.epsilon if self.answer and not inferred else None

    @cached_property
    def fit(self) -> Fit:
        """The fit of the candidate to the record, from which samplers and evidence methods start.

        It is the posterior mode that the task `mode/...` has stored or, if the study has deviation = "law", the fit
        with deviations from the laws that the task `ANSWER` on the record has stored. Raises Refusal if this task gave
        no mode or not this fit, and KeyError if it has no stored result.
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
