"""What an estimator is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict

from bayesdamp.types import Estimate, Problem, Signal


class Options(BaseModel):
    """Options of one estimator: a frozen model with defaults that refuses what it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


Chosen = TypeVar("Chosen", bound=Options)


class Estimator(ABC, Generic[Chosen]):
    """A way to read damping coefficients off one record.

    name: of an estimator of the package the name of its file. options: the class of its options.
    """

    name: str
    options: type[Chosen]
    by_position: str = ""
    """Why it cannot estimate a force that depends on the position, in a clause; empty where it can."""
    with_parameters: str = ""
    """Why it cannot estimate a term with parameters beside its coefficient; empty where it can."""

    def __init_subclass__(cls) -> None:
        """Name an estimator of the package by its file."""
        super().__init_subclass__()
        package, _, file = cls.__module__.rpartition(".")
        if package == f"{__package__}.methods":
            cls.name = file

    def refuses(self, damping: tuple[str, ...]) -> str | None:
        """A sentence why this sum of damping terms cannot be estimated, or None, which is the default."""
        return None

    @abstractmethod
    def initial(
        self, signal: Signal, problem: Problem, options: Chosen, rng: np.random.Generator
    ) -> Estimate:
        """The method's own estimate from the record and what is known of the system.

        Raises Refusal with a sentence where the method cannot work on the record.
        """
