"""What cells hold comes back as it was, and something else is not taken for it."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from bayesdamp.store import CellResult, Store
from bayesdamp.store.contents.answers import AnswerContent, SampledPosterior, WeighedCandidate
from bayesdamp.store.contents.candidates import Climb, ModeContent, Part, SecondHalf
from bayesdamp.store.contents.content import Content
from bayesdamp.store.contents.records import NoiseContent, NoiseTried, RecordContent, Scales, WidthTried

RECORD = RecordContent(
    "bench", "rad", "angle", 0.001, {"start": 2.0, "notes": ["cut"]}, features={"period": 1.4, "rest": 0.1},
    anomalies=("it beats",), reference=Scales(0.3, 4.5), known={"epsilon": 0.02}, noisy=True,
)  # fmt: skip
NOISE = NoiseContent(
    "gaussian", ("viscous", "coulomb"), "linear", {"linear": {"zeta": 0.05}},
    (NoiseTried("gaussian", -1.5, {"noise_sd": 0.003}), NoiseTried("quantised", outcome="no step")),
    epsilon=0.02, epsilons=(WidthTried(0.02, 0.1, -3.0, {"mu_c": (0.04, 0.001)}),),
)  # fmt: skip
MODE = ModeContent(
    {"zeta": 0.05}, {"zeta": 0.001}, {}, {"zeta": "halfnormal"}, 12.5, 1e-6, {"step_error": 1e-8},
    (Climb("koopman", ("sindy",), -5.0, 12.5, 30, -2.0, True, 1.5, 0),), (), ("mu_c",),
    windows=(Part("whole", 0.0, 6.0, {"zeta": 0.05}, {"zeta": 0.001}, math.inf),),
    forecast=SecondHalf(0.1, 0.1, 0.95, 30.0), rms=0.003, verdict="fits: well",
)  # fmt: skip
ANSWER = AnswerContent(
    {"record": "bench"}, (WeighedCandidate("viscous", "linear", None, -1.0, 0.003),), {"linear": {"zeta": 0.05}},
    posteriors=(
        SampledPosterior("viscous", "linear", {"zeta": {"mean": 0.05}}, (0.0, 0.01, 0.1), 0.0, 9.0, 0.1, 1.0, 1),
    ),
)  # fmt: skip


@pytest.mark.parametrize("content", [RECORD, NOISE, MODE, ANSWER], ids=lambda c: type(c).__name__)
def test_through_a_file(tmp_path: Path, content: Content) -> None:
    """Lists come back as the tuples that they were, infinities as themselves."""
    store = Store(tmp_path)
    with store.lock():
        store.write(CellResult("one/cell/0", "key", content.meta()))
    assert repr(type(content).of(store.read("one/cell/0"))) == repr(content)


def test_something_else_is_not_taken_for_it() -> None:
    with pytest.raises(ValueError, match="values"):
        ModeContent.of_meta({"values": "none"})
    with pytest.raises(ValueError, match="chosen"):
        NoiseContent.of_meta(RECORD.meta())


def test_a_record_without_oscillation_has_no_scales() -> None:
    with pytest.raises(ValueError, match="shows no oscillation"):
        _ = RecordContent("flat").scales
