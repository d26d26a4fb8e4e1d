"""What a method for the evidence is."""

from __future__ import annotations

from abc import ABC, abstractmethod

from bayesdamp.inference.mode import Mode
from bayesdamp.inference.target import Target
from bayesdamp.types import Evidence


class EvidenceMethod(ABC):
    """log ∫ prior · likelihood of one target, in nats."""

    name: str

    @abstractmethod
    def evidence(self, model: str, target: Target, mode: Mode, seed: int) -> Evidence:
        """The log evidence with its standard error and the diagnostic by which it may be trusted."""
