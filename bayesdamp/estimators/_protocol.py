"""Define the base class of estimators, decide which damping terms each can estimate, and import optional packages."""

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
    """Import and return a package that only some estimators need.

    Raises
    ------
    Refusal
        If the package is not installed. The message says how to install it.
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
    """Options of an estimator. Subclasses have a field with a default for each option; unknown options are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


OptionsType = TypeVar("OptionsType", bound=Options)


class Estimator(ABC, Generic[OptionsType]):
    """A method that estimates damping coefficients from one record.

    name: name of the estimator; for those of this package the name of the file. options: class of its options.
    """

    name: str
    options: type[OptionsType]
    by_position: str = ""
    """The reason, as a clause, why the method cannot estimate a damping force that depends on the position; "" if it
    can."""

    def __init_subclass__(cls) -> None:
        """Set the name of an estimator of this package to the name of its file."""
        super().__init_subclass__()
        package, _, file = cls.__module__.rpartition(".")
        if package == f"{__package__}.methods":
            cls.name = file

    def refuses(self, damping: tuple[str, ...]) -> str | None:
        """Return a reason of this method's own why it cannot estimate a sum of damping terms, or None (the default).

        damping: names of the terms. The reason is text for a message, without a capital letter and a full stop.
        `reason_not_applicable` asks this first, then applies `by_position`, and refuses terms that have parameters
        besides their coefficient.
        """
        return None

    @abstractmethod
    def initial(
        self, signal: Signal, problem: Problem, options: OptionsType, rng: np.random.Generator
    ) -> Estimate:
        """Estimate the unknown parameters from the record.

        Parameters
        ----------
        signal, problem
            The record; the damping terms to estimate, and the known parameters of the system.
        options
            Options of this estimator.
        rng
            The only source of random numbers for methods that need them.

        Returns
        -------
        Estimate
            Values of the damping coefficients and of the unknown restoring and start parameters, by name, in SI units.
            `estimators.run` adds the estimator's name, the stage and the duration.

        Raises
        ------
        Refusal
            If the method cannot be applied to the record. The message is a sentence.
        """


def reason_not_applicable(estimator: Estimator[Any], damping: tuple[str, ...]) -> str | None:
    """Return the reason why an estimator cannot estimate a sum of these damping terms, or None if it can.

    damping: names of the terms. The reason is text for a message, without a capital letter and a full stop.
    """
    if reason := estimator.refuses(damping):
        return reason
    for term in map(TERMS.get, damping):
        if term.placed and estimator.by_position:
            return (
                f"the method cannot estimate {term.name} damping, which depends on the position: "
                f"{estimator.by_position}"
            )
        if term.inferred:
            return (
                f"{term.name} damping has parameters besides its coefficient, which estimators do not estimate; use "
                "bd.fit or bayesdamp compare"
            )
    return None


def table(estimators: Sequence[Estimator[Any]], terms: Sequence[str]) -> list[tuple[str, list[str | None]]]:
    """Return a row for each estimator: its name, and for each damping term the reason why it cannot estimate this term.

    terms: names of damping terms, each of which is considered alone, not in a sum. A reason is a text as returned by
    `reason_not_applicable`, or None if the estimator can estimate the term.
    """
    return [(e.name, [reason_not_applicable(e, (term,)) for term in terms]) for e in estimators]
