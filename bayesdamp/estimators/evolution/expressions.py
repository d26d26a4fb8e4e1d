"""Expressions in one variable: sums of products of v, |…| and tanh(…), simplified as they are made."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

SMALL = 1e-3
"""tanh(x) is x where x is no larger: to a millionth."""


@dataclass(frozen=True)
class Atom:
    """A factor: the variable ("v"), or "abs" or "tanh" of an expression."""

    kind: str
    inner: Expression | None = None


@dataclass(frozen=True)
class Expression:
    """Σ coefficient · Π atoms, each product once: terms maps the atoms of a product to its coefficient."""

    terms: tuple[tuple[tuple[Atom, ...], float], ...]

    @classmethod
    def constant(cls, value: float) -> Expression:
        """An expression that is one number at every velocity."""
        return cls((((), float(value)),))

    @classmethod
    def variable(cls, weight: float) -> Expression:
        """The velocity times a weight."""
        return cls((((Atom("v"),), float(weight)),))

    @property
    def depends(self) -> bool:
        """Whether it is more than a constant."""
        return any(atoms for atoms, _ in self.terms)

    def __add__(self, other: Expression) -> Expression:
        return _collected([*self.terms, *other.terms])

    def __mul__(self, other: Expression) -> Expression:
        return _collected([(_product(a + b), x * y) for a, x in self.terms for b, y in other.terms])

    def scaled(self, factor: float) -> Expression:
        """factor · expression."""
        return Expression(tuple((atoms, factor * c) for atoms, c in self.terms))

    def apply(self, kind: str, largest: float = np.inf) -> Expression:
        """|expression| or tanh(expression); largest: its largest size, where it is known."""
        if not self.terms:
            return self
        if all(not atoms for atoms, _ in self.terms):
            value = self.terms[0][1]
            return Expression.constant(abs(value) if kind == "abs" else np.tanh(value))
        if kind == "tanh" and largest <= SMALL:
            return self
        inner, outer = self, 1.0
        if kind == "abs" and len(self.terms) == 1:
            ((atoms, c),) = self.terms
            inner, outer = Expression(((atoms, 1.0),)), abs(c)
        elif self.terms[0][1] < 0:
            inner, outer = self.scaled(-1.0), 1.0 if kind == "abs" else -1.0
        return Expression((((Atom(kind, inner),), outer),))

    def __call__(self, v: np.ndarray) -> np.ndarray:
        """Values at v (n,), shape (n,)."""
        total = np.zeros_like(v)
        for atoms, c in self.terms:
            product = np.full_like(v, c)
            for atom in atoms:
                if atom.inner is None:
                    product = product * v
                else:
                    product = product * (np.abs if atom.kind == "abs" else np.tanh)(atom.inner(v))
            total = total + product
        return total

    def constants(self) -> np.ndarray:
        """Every constant, in the order in which `with_constants` takes them."""
        found: list[float] = []
        for atoms, c in self.terms:
            found.append(c)
            for atom in atoms:
                if atom.inner is not None and not _unit(atom):
                    found.extend(atom.inner.constants())
        return np.array(found)

    def with_constants(self, values: np.ndarray) -> Expression:
        """The same expression with other constants."""
        return self._filled(iter(np.asarray(values, float).tolist()))

    def _filled(self, values: Iterator[float]) -> Expression:
        terms = []
        for atoms, _ in self.terms:
            c = next(values)
            filled = tuple(
                atom if atom.inner is None or _unit(atom) else Atom(atom.kind, atom.inner._filled(values))
                for atom in atoms
            )
            terms.append((filled, c))
        return Expression(tuple(terms))

    def stretched(self, scale: float) -> Expression:
        """The expression of v/scale, as one of v."""
        terms: Expression = Expression(())
        for atoms, c in self.terms:
            product = Expression.constant(c)
            for atom in atoms:
                if atom.inner is None:
                    product = product * Expression.variable(1 / scale)
                else:
                    product = product * atom.inner.stretched(scale).apply(atom.kind)
            terms = terms + product
        return terms

    def without_the_negligible(self, v: np.ndarray, share: float) -> Expression:
        """Without the products whose root mean square over v (n,) is below a share of the whole's."""
        whole = float(np.sqrt(np.mean(self(v) ** 2)))
        sizes = [np.sqrt(np.mean(Expression((term,))(v) ** 2)) for term in self.terms]
        kept = tuple(term for term, size in zip(self.terms, sizes) if size > share * whole)
        return Expression(kept)

    def widths(self) -> list[float]:
        """1/w of every tanh(w·v)."""
        found = []
        for atoms, _ in self.terms:
            for atom in atoms:
                if atom.inner is None:
                    continue
                terms = atom.inner.terms
                if atom.kind == "tanh" and len(terms) == 1 and terms[0][0] == (Atom("v"),):
                    found.append(1 / terms[0][1])
                found.extend(atom.inner.widths())
        return found

    def __str__(self) -> str:
        text = ""
        for atoms, c in self.terms:
            factors = ["v" if a.inner is None else f"|{a.inner}|" if a.kind == "abs" else f"tanh({a.inner})"
                       for a in atoms]  # fmt: skip
            size = f"{abs(c):.6g}" if abs(c) != 1 or not atoms else ""
            sign = (" − " if c < 0 else " + ") if text else ("−" if c < 0 else "")
            text += sign + "·".join([size] * bool(size) + factors)
        return text or "0"


def _unit(atom: Atom) -> bool:
    """Whether an atom is |one product with the factor 1|: that factor is no constant of its own."""
    assert atom.inner is not None
    return atom.kind == "abs" and len(atom.inner.terms) == 1


def _product(atoms: tuple[Atom, ...]) -> tuple[Atom, ...]:
    """Atoms in order; |v|·|v| is v·v."""
    size = Atom("abs", Expression.variable(1.0))
    pairs = 2 * (atoms.count(size) // 2)
    kept, left = [], pairs
    for atom in atoms:
        if atom == size and left:
            left -= 1
            continue
        kept.append(atom)
    return tuple(sorted([*kept, *[Atom("v")] * pairs], key=repr))


def _collected(terms: list[tuple[tuple[Atom, ...], float]]) -> Expression:
    total: dict[tuple[Atom, ...], float] = {}
    for atoms, c in terms:
        total[atoms] = total.get(atoms, 0.0) + c
    return Expression(tuple(sorted(((a, c) for a, c in total.items() if c != 0.0), key=repr)))
