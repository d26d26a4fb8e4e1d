"""Every kind of stored content is read as it was written, and content of another kind is refused."""

import json
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

from bayesdamp.store.results import (
    AnswerContent,
    ChunkContent,
    Content,
    ModeContent,
    RecordContent,
    Store,
    TaskResult,
)
from bayesdamp.types import Provenance

PLAIN: dict[type, Iterator[Any]] = {
    float: cycle([1 / 3, math.inf, math.nan, -5e-324]), int: cycle([0, 7]), bool: cycle([True, False]),
    str: cycle(["é", "a: b"]), np.ndarray: cycle([np.array([])]),
}  # fmt: skip
ANYTHING = {"notes": ["cut", {"omega": None}], "start": 2.0}


def example(kind: Any) -> Any:
    """Return a value of a type, with something in every field."""
    origin, inner = get_origin(kind), [arg for arg in get_args(kind) if arg not in (Ellipsis, NoneType)]
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


@pytest.mark.parametrize("kind", sorted(set(kinds()) - {ChunkContent}, key=str))
def test_content_is_read_from_its_file_as_it_was_written(tmp_path: Path, kind: type[Content]) -> None:
    """Also tuples, which JSON stores as lists, infinities and NaN."""
    store, content = Store(tmp_path), example(kind)
    with store.lock():
        store.write(TaskResult("kind/record/0", "key", content.meta()))
    assert repr(kind.of(store.read("kind/record/0"))) == repr(content)


def test_provenance_of_a_record_is_read_as_it_was_written() -> None:
    for provenance in (example(Provenance), Provenance()):
        assert repr(Provenance.of(json.loads(json.dumps(provenance.to_dict())))) == repr(provenance)


def test_content_of_another_kind_or_version_is_refused() -> None:
    with pytest.raises(ValueError, match="another version"):
        ModeContent.of_meta({"values": "none"})
    with pytest.raises(ValueError, match="another version"):
        AnswerContent.of_meta(example(RecordContent).meta())


def test_a_task_without_a_result_has_no_content() -> None:
    assert ModeContent.maybe(None) is None
    assert ModeContent.maybe(TaskResult("mode/a/0/viscous", "key", outcome="no mode")) is None
