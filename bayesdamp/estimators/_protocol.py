"""What an estimator is, which damping terms it can estimate, and the optional packages that it may need."""

from __future__ import annotations

import importlib
import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Generic, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict

from bayesdamp.physics.damping import TERMS
from bayesdamp.types import Estimate, Problem, Refusal, Signal


def optional_package(name: str) -> Any:
    """Import a package that only some estimators need, and that may not be installed.

    Raises
    ------
    Refusal
        If the package is not installed; the text says how to install it.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pysindy warns when it is imported
            return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            raise
        raise Refusal(
            f'this estimator needs {name}; install it with: pip install "bayesdamp[paper]"'
        ) from error


class Options(BaseModel):
    """Options of one estimator: a frozen model with defaults that refuses unknown fields."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


Chosen = TypeVar("Chosen", bound=Options)


class Estimator(ABC, Generic[Chosen]):
    """A method that estimates damping coefficients from one record.

    name: for an estimator of the package, the name of its file. options: the class of its options.
    """

    name: str
    options: type[Chosen]
    by_position: str = ""
    """Why it cannot estimate a force that depends on the position, as a clause; empty if it can."""
    with_parameters: str = ""
    """Why it cannot estimate a term that has parameters besides its coefficient; empty if it can."""

    def __init_subclass__(cls) -> None:
        """Name an estimator of the package after its file."""
        super().__init_subclass__()
        package, _, file = cls.__module__.rpartition(".")
        if package == f"{__package__}.methods":
            cls.name = file

    def refuses(self, damping: tuple[str, ...]) -> str | None:
        """Return a sentence why this sum of damping terms cannot be estimated, or None, which is the default."""
        return None

    @abstractmethod
    def initial(
        self, signal: Signal, problem: Problem, options: Chosen, rng: np.random.Generator
    ) -> Estimate:
        """Return the method's own estimate from the record and what is known of the system.

        Raises
        ------
        Refusal
            If the method cannot work on the record; the text is a sentence.
        """


def refusal(estimator: Estimator[Any], damping: tuple[str, ...]) -> str | None:
    """Return a sentence why an estimator cannot estimate this sum of damping terms, or None."""
    if reason := estimator.refuses(damping):
        return reason
    for term in map(TERMS.get, damping):
        if term.placed and estimator.by_position:
            return f"{term.name} damping depends on the position: {estimator.by_position}"
        if term.inferred and estimator.with_parameters:
            return f"{term.name} damping has parameters besides its coefficient: {estimator.with_parameters}"
    return None


def table(estimators: Sequence[Estimator[Any]], terms: Sequence[str]) -> list[tuple[str, list[str | None]]]:
    """Return a row for each estimator: its name, and for each single term its `refusal`."""
    return [(e.name, [refusal(e, (term,)) for term in terms]) for e in estimators]
