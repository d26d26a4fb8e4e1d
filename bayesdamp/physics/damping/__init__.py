"""Damping terms: one class in one module each, found by name."""

from __future__ import annotations

from itertools import combinations

from bayesdamp.physics.damping._term import DampingTerm
from bayesdamp.plugins import Registry
from bayesdamp.types import InputError

TERMS: Registry[DampingTerm] = Registry("bayesdamp.physics.damping", "damping term")
PAPER_TERMS = ("viscous", "coulomb", "quadratic")

__all__ = ["PAPER_TERMS", "TERMS", "DampingTerm", "all_sums", "model_name", "parse_model"]


def parse_model(name: str) -> tuple[str, ...]:
    """`viscous+coulomb` as its terms, in the order given.

    Raises InputError on an unknown, repeated or missing term.
    """
    terms = tuple(part.strip() for part in name.split("+"))
    if len(set(terms)) != len(terms) or not all(terms):
        raise InputError(f"damping model {name!r} must be a sum of different terms, such as viscous+coulomb")
    for term in terms:
        TERMS.get(term)
    return terms


def model_name(terms: tuple[str, ...]) -> str:
    """The name of a sum of terms."""
    return "+".join(terms)


def all_sums(terms: tuple[str, ...] = PAPER_TERMS) -> list[str]:
    """All non-empty sums of the terms, single ones first: seven for the paper's three."""
    return ["+".join(c) for n in range(1, len(terms) + 1) for c in combinations(terms, n)]
