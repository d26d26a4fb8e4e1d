"""What cells hold comes back as it was, and something else is not taken for it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from itertools import cycle
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
import pytest

from bayesdamp.store import CellResult, Store
from bayesdamp.store.contents import (
    AnswerContent,
    ChunkContent,
    Content,
    JointContent,
    ModeContent,
    RecordContent,
)
from tests.failures import Failures

KOOPMAN = Seed("koopman", "initial", grown=True)
RECORD = RecordContent(
    "bench", "rad", "angle", 0.001, {"start": 2.0, "notes": ["cut"]},
    features=FeaturesSeen(0.1, 0.3, 0.1, 4.5, 1.4, 9.0, 140.0, 0.001),
    anomalies=("it beats",), reference=Reference(0.3, 4.5), known={"epsilon": 0.02}, noisy=True,
)  # fmt: skip
MODE = ModeContent(
    values={"zeta": 0.05}, sd={"zeta": 0.001}, known={}, priors={"zeta": "halfnormal"}, log_posterior=12.5,
    error_budget={"step_error": 1e-8}, touching_zero=("mu_c",),
    climbs=(Climb(KOOPMAN, (Seed("prior 1", drawn=True),), -5.0, 12.5, 30, -2.0, True, 1.5, 0),),
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


def example(kind: Any) -> Any:
    """Return a value of a type, with something in every field."""
    origin, inner = get_origin(kind), [one for one in get_args(kind) if one not in (Ellipsis, NoneType)]
    if origin in (Union, UnionType):
        return example(inner[0])
    if origin is tuple:
        return tuple(map(example, inner if Ellipsis not in get_args(kind) else inner * 2))
    if origin is not None and issubclass(origin, Mapping):
        return {"zeta": example(inner[1]), "mu_c": example(inner[1])}
    if kind in (Any, object):
        return ANYTHING
    if is_dataclass(kind) and isinstance(kind, type):
        hints = get_type_hints(kind, localns={"np": np})
        return kind(**{f.name: example(hints[f.name]) for f in fields(kind) if f.init})
    return next(iter(kind)) if issubclass(kind, Enum) else next(PLAIN[origin or kind])


def kinds(above: type[Content] = Content) -> Iterator[type[Content]]:
    for kind in above.__subclasses__():
        yield from (kind, *kinds(kind))


def test_through_a_file(tmp_path: Path) -> None:
    """Lists come back as the tuples that they were, infinities as themselves; of every kind of content."""
    store = Store(tmp_path)
    with Failures() as failures, store.lock():
        for kind in set(kinds()) - {ChunkContent}:
            with failures.of(kind.__name__):
                content = example(kind)
                store.write(CellResult("one/cell/0", "key", content.meta()))
                assert repr(kind.of(store.read("one/cell/0"))) == repr(content)


def test_something_else_is_not_taken_for_it() -> None:
    with pytest.raises(ValueError, match="another version"):
        ModeContent.of_meta({"values": "none"})
    with pytest.raises(ValueError, match="another version"):
        AnswerContent.of_meta(example(RecordContent).meta())


def test_a_cell_that_says_why_not_has_no_content() -> None:
    assert JointContent.maybe(None) is None
    assert JointContent.maybe(CellResult("joint/a", "key", outcome="no joint fit")) is None
