"""What cells hold comes back as it was, and something else is not taken for it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.store import CellResult, Store
from bayesdamp.store.contents import (
    AnswerContent,
    AverageContent,
    ChunkContent,
    Climb,
    Content,
    EnvelopeContent,
    EstimateContent,
    EvidenceContent,
    FeaturesSeen,
    FoundLaw,
    HalfContent,
    JointCandidate,
    JointContent,
    ModeContent,
    NoisesContent,
    PopulationContent,
    PopulationFound,
    PosteriorContent,
    RanksContent,
    RatiosContent,
    RecordContent,
    RecoveryContent,
    Reference,
    RefusedSeed,
    SampledPosterior,
    UnderNoise,
    WeighedCandidate,
    WeighedNoise,
    WeighingContent,
    WidthsContent,
)
from bayesdamp.types import ChainStart, Estimate, Evidence, Forecast, NestedRatio, PartialFit, Posterior, Seed
from tests.failures import Failures

KOOPMAN = Seed("koopman", "initial", grown=True)
RECORD = RecordContent(
    "bench", "rad", "angle", 0.001, {"start": 2.0, "notes": ["cut"]},
    features=FeaturesSeen(0.1, 0.3, 0.1, 4.5, 1.4, 9.0, 140.0, 0.001),
    anomalies=("it beats",), reference=Reference(0.3, 4.5), known={"epsilon": 0.02}, noisy=True,
)  # fmt: skip
MODE = ModeContent(
    {"zeta": 0.05}, {"zeta": 0.001}, {}, {"zeta": "halfnormal"}, 12.5, {"step_error": 1e-8},
    (Climb(KOOPMAN, (Seed("prior 1", drawn=True),), -5.0, 12.5, 30, -2.0, True, 1.5, 0),), (), ("mu_c",),
    windows=(PartialFit("whole", 0.0, 6.0, {"zeta": 0.05}, {"zeta": 0.001}, math.inf),),
    forecast=Forecast(0.1, 0.1, 0.95, 30.0), rms=0.003, verdict="fits: well",
    refused=(RefusedSeed(Seed("pinn"), "no convergence"),),
)  # fmt: skip
ANSWER = AnswerContent(
    {"record": "bench"}, (WeighedCandidate("viscous", "linear", None, -1.0, 0.003),), {"linear": {"zeta": 0.05}},
    posteriors=(
        SampledPosterior("viscous", "linear", {"zeta": {"mean": 0.05}}, (0.0, 0.01, 0.1), 0.0, 9.0, 0.1, 1.0, 1),
    ),
    laws=(FoundLaw("viscous", "linear", {"terms": ["viscous"]}),),
    noise="gaussian", noises=(WeighedNoise("gaussian", -1.5, {"noise_sd": 0.003}),), terms=("viscous",),
)  # fmt: skip

SUMMARY = {"mean": 0.05, "sd": 0.001, "rhat": math.nan}
ESTIMATE = EstimateContent(
    (Estimate("koopman", "initial", {"zeta": 0.05}, {}, {}, {"selected": ["v"]}, 30, 0.1),)
)
NONE = np.array([])
DRAWN = Posterior(
    "nuts", ("zeta",), NONE, NONE, diagnostics={"step": 0.3},
    starts=(ChainStart(KOOPMAN, 1.5, 1.0, 0.01),), divergences=0, running=("zeta",),
)  # fmt: skip
POSTERIOR = PosteriorContent(
    DRAWN, {"zeta": ""}, {"zeta": SUMMARY}, 0.3, {"decrement": 3}, "posterior/one.nc"
)
AVERAGE = AverageContent({"viscous": 0.9, "coulomb": 0.1}, "importance", 1.0, ("coulomb",))
EVIDENCE = EvidenceContent(Evidence("viscous", "bridge", 9.0, 0.1, "overlap 0.9", 300, 1.0))
HALF = HalfContent(
    0.1, 0.1, 0.95, 30.0, start=3.0, log_predictive_stderr=0.2, evidence=Evidence("viscous", "bridge")
)
NOISES = NoisesContent(
    "gaussian", {"gaussian": UnderNoise(9.0), "quantised": UnderNoise(-math.inf, "no step")}
)
RATIOS = RatiosContent({"viscous": NestedRatio(2.0, 0.1), "coulomb": NestedRatio(outcome="too few draws")})
POPULATION = PopulationFound(0.1, SUMMARY, SUMMARY, {"a": SUMMARY}, {"a": 900.0}, "only 3")
JOINT = JointContent(
    ("a1", "a2"), (("a1", 0), ("a2", 0)), Reference(0.3, 4.5), "viscous",
    {"viscous": JointCandidate("ok", 9.0, {"zeta": SUMMARY}, {"zeta": ""}, 1.0),
     "coulomb": JointCandidate("pruned: far behind")},
    SUMMARY, math.nan, {"a1": WeighingContent("ok", 4.5)}, {"power": 0.1},
)  # fmt: skip
OVER = PopulationContent(
    "viscous",
    {"viscous": 9.0},
    {"a": 0.0},
    {"a": JointCandidate("ok", 9.0)},
    {"zeta": ""},
    {"zeta": POPULATION},
)
RANKS = RanksContent(
    ("ok", "none"), (True, False), 8, "viscous", ("zeta",), {"nuts": ("ok", "")}, {"record": 1.0, "nuts": 2.0}
)
RECOVERY = RecoveryContent(("ok",), (True,), 4, ("viscous", "coulomb"), (("ok", "poor"),))
OF_RATES = {"viscous": {"reference": 0.5, "unit": "dBm", "omega": None}}
ENVELOPE = AnswerContent({"record": "r"}, envelope=EnvelopeContent("dBm", 400, OF_RATES, ("A sentence.",)))
ALL = [
    RECORD, MODE, ANSWER, ESTIMATE, POSTERIOR, AVERAGE, EVIDENCE, WidthsContent(("zeta",)), HALF, NOISES, RATIOS,
    JOINT, OVER, RANKS, RECOVERY, ENVELOPE,
]  # fmt: skip


def test_through_a_file(tmp_path: Path) -> None:
    """Lists come back as the tuples that they were, infinities as themselves."""
    store = Store(tmp_path)
    with Failures() as failures, store.lock():
        for content in ALL:
            with failures.of(type(content).__name__):
                store.write(CellResult("one/cell/0", "key", content.meta()))
                assert repr(type(content).of(store.read("one/cell/0"))) == repr(content)


def test_something_else_is_not_taken_for_it() -> None:
    with pytest.raises(ValueError, match="another version"):
        ModeContent.of_meta({"values": "none"})
    with pytest.raises(ValueError, match="another version"):
        AnswerContent.of_meta(RECORD.meta())


def test_every_kind_of_content_is_tried() -> None:
    def below(kind: type) -> Iterator[type]:
        for one in kind.__subclasses__():
            yield from (one, *below(one))

    assert set(below(Content)) - {ChunkContent} == {type(one) for one in ALL}


def test_a_cell_that_says_why_not_has_no_content() -> None:
    assert JointContent.maybe(None) is None
    assert JointContent.maybe(CellResult("joint/a", "key", outcome="no joint fit")) is None
    assert repr(JointContent.maybe(CellResult("joint/a", "key", JOINT.meta()))) == repr(JOINT)
