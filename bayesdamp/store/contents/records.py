"""What is stored of a record, and of what was chosen for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from bayesdamp.store.contents.content import Content
from bayesdamp.types import FeaturesSeen, Reference


@dataclass(frozen=True)
class RecordContent(Content):
    """A record (`signal/NAME/REPEAT`).

    provenance: what was done to it. step: recording step, 0 where none is seen. bound: the Cramér–Rao bound of a
    simulated one, sd by parameter. Where it shows an oscillation: features; anomalies, in words;
    reference; known: of the system, friction's ε (rad/s) filled in, with a note; noisy: whether there is noise to weigh
    by.
    """

    name: str = ""
    unit: str = "rad"
    quantity: str = "angle"
    step: float = 0.0
    provenance: Mapping[str, Any] = field(default_factory=dict)
    bound: Mapping[str, float] = field(default_factory=dict)
    features: FeaturesSeen | None = None
    anomalies: tuple[str, ...] = ()
    reference: Reference | None = None
    known: Mapping[str, float] = field(default_factory=dict)
    epsilon_note: str = ""
    noisy: bool = False

    @property
    def scales(self) -> Reference:
        """The reference of a record with an oscillation. Raises ValueError where it has none."""
        if self.reference is None:
            raise ValueError(f"{self.name} shows no oscillation")
        return self.reference
