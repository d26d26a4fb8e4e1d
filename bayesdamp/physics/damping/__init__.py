"""Register damping terms: one class in one module each, found by name."""

from __future__ import annotations

from itertools import combinations

from bayesdamp.physics.damping._term import EXACT, GIVEN, TINY, DampingTerm, FreeParameter, median
from bayesdamp.plugins import Registry
from bayesdamp.types import InputError

TERMS: Registry[DampingTerm] = Registry("bayesdamp.physics.damping", "damping term")
PAPER_TERMS = ("viscous", "coulomb", "quadratic")

__all__ = [
    "EXACT", "GIVEN", "PAPER_TERMS", "TERMS", "TINY", "DampingTerm", "FreeParameter", "all_sums", "median",
    "others", "parse_model", "twins_of", "words_of",
]  # fmt: skip


def parse_model(name: str) -> tuple[str, ...]:
    """Return the terms of a sum such as `viscous+coulomb`, in their order.

    Raises
    ------
    InputError
        For an unknown, repeated or missing term, and for two terms with a parameter of the same name.
    """
    terms = tuple(part.strip() for part in name.split("+"))
    if len(set(terms)) != len(terms) or not all(terms):
        raise InputError(f"damping model {name!r} must be a sum of different terms, such as viscous+coulomb")
    owner: dict[str, str] = {}
    for term in terms:
        for parameter in TERMS.get(term).inferred:
            if parameter.name in owner:
                both = f"{owner[parameter.name]} and {term} both have a parameter {parameter.name!r}"
                raise InputError(f"damping model {name!r}: {both}; compare them one by one")
            owner[parameter.name] = term
    return terms


def others() -> list[str]:
    """Return the terms that ship besides the paper's."""
    return [name for name in TERMS.names() if TERMS.ships(name) and name not in PAPER_TERMS]


ARTICLES = ("a", "an", "the")


def words_of(term: str) -> str:
    """Return the words for a term in a sentence, without an article, so that "damping" can follow.

    It is the term's name where it has no words or is not known here.
    """
    words = (TERMS.get(term).words if term in TERMS.names() else "") or term
    first, _, rest = words.partition(" ")
    return rest if rest and first.lower() in ARTICLES else words


def twins_of(term: str) -> list[str]:
    """Return the terms that take as much energy at every amplitude as this one."""
    names = TERMS.present()
    own = [TERMS.get(term).twin] if term in names else []
    return [n for n in names if n != term and (n in own or TERMS.get(n).twin == term)]


def all_sums() -> list[str]:
    """Return the seven sums of the paper's terms, single ones first."""
    return ["+".join(c) for n in (1, 2, 3) for c in combinations(PAPER_TERMS, n)]
