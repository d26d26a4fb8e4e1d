"""Define expressions of the velocity v, and search for them by genetic programming (the library Operon).

An expression is a sum of products of v, |…| and tanh(…), which is simplified whenever it is built.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
import pyoperon

op: Any = pyoperon  # compiled, and without stubs

SMALL = 1e-3
"""tanh(x) is replaced by x if |x| is not larger than this; the relative error is then 3e-7 at most."""


@dataclass(frozen=True)
class Atom:
    """A factor of a product: the variable (kind "v"), or the function "abs" or "tanh" of `inner`."""

    kind: str
    inner: Expression | None = None


@dataclass(frozen=True)
class Expression:
    """The sum Σ coefficient · Π atoms. terms: the atoms and the coefficient of each product; all products differ."""

    terms: tuple[tuple[tuple[Atom, ...], float], ...]

    @classmethod
    def constant(cls, value: float) -> Expression:
        """Return the expression that has the same value for all velocities."""
        return cls((((), float(value)),))

    @classmethod
    def variable(cls, weight: float) -> Expression:
        """Return the expression weight · v, the velocity times a number."""
        return cls((((Atom("v"),), float(weight)),))

    @property
    def is_variable(self) -> bool:
        """Return whether the expression depends on the velocity."""
        return any(atoms for atoms, _ in self.terms)

    def __add__(self, other: Expression) -> Expression:
        return _collect([*self.terms, *other.terms])

    def __mul__(self, other: Expression) -> Expression:
        return _collect([(a + b, x * y) for a, x in self.terms for b, y in other.terms])

    def scaled(self, factor: float) -> Expression:
        """Return the expression multiplied by a constant factor."""
        return Expression(tuple((atoms, factor * c) for atoms, c in self.terms))

    def apply(self, kind: str, largest: float = np.inf) -> Expression:
        """Return |expression| (kind "abs") or tanh(expression) (kind "tanh").

        largest: the largest absolute value of the expression, if known. If this is at most `SMALL`, tanh(x) is nearly
        x, and the expression itself is returned for "tanh".
        """
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
        """Return the values of the expression at velocities v (n,), shape (n,)."""
        total = np.zeros_like(v)
        for atoms, c in self.terms:
            product = np.full_like(v, c)
            for atom in atoms:
                function = np.abs if atom.kind == "abs" else np.tanh
                product = product * (v if atom.inner is None else function(atom.inner(v)))
            total = total + product
        return total

    def constants(self) -> np.ndarray:
        """Return all constants, (k,): of each product its coefficient, then the constants inside its functions.

        The coefficient of a product inside |product| is left out: it is always 1.
        """
        constants: list[float] = []
        for atoms, c in self.terms:
            constants.append(c)
            for atom in atoms:
                if atom.inner is not None:
                    constants.extend(atom.inner.constants()[_is_unit(atom) :])
        return np.array(constants)

    def with_constants(self, values: Iterable[float]) -> Expression:
        """Return the expression with its constants replaced by `values`, (k,), in the order of `constants`."""
        values = iter(values)
        terms = []
        for atoms, _ in self.terms:
            c, filled = float(next(values)), []
            for atom in atoms:
                if atom.inner is not None:
                    inner = chain((1.0,), values) if _is_unit(atom) else values
                    atom = Atom(atom.kind, atom.inner.with_constants(inner))
                filled.append(atom)
            terms.append((tuple(filled), c))
        return Expression(tuple(terms))

    def stretched(self, scale: float) -> Expression:
        """Return the expression with v replaced by v/scale."""
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
        """Return the expression without products whose rms over v (n,) is at most `share` times that of the sum."""
        whole = float(np.sqrt(np.mean(self(v) ** 2)))
        sizes = [np.sqrt(np.mean(Expression((term,))(v) ** 2)) for term in self.terms]
        return Expression(tuple(term for term, size in zip(self.terms, sizes) if size > share * whole))

    def widths(self) -> list[float]:
        """Return the width 1/w of every factor tanh(w·v), also inside other functions.

        It is in the unit of v, and negative if w is.
        """
        widths = []
        for atoms, _ in self.terms:
            for atom in atoms:
                if atom.inner is None:
                    continue
                terms = atom.inner.terms
                if atom.kind == "tanh" and len(terms) == 1 and terms[0][0] == (Atom("v"),):
                    widths.append(1 / terms[0][1])
                widths.extend(atom.inner.widths())
        return widths

    def __str__(self) -> str:
        text = ""
        for atoms, c in self.terms:
            factors = ["v" if a.inner is None else f"|{a.inner}|" if a.kind == "abs" else f"tanh({a.inner})"
                       for a in atoms]  # fmt: skip
            size = f"{abs(c):.6g}" if abs(c) != 1 or not atoms else ""
            sign = (" − " if c < 0 else " + ") if text else ("−" if c < 0 else "")
            text += sign + "·".join([size] * bool(size) + factors)
        return text or "0"


def _is_unit(atom: Atom) -> bool:
    """Return whether an atom is |product|.

    The coefficient of that inner product is always 1, because `apply` moves its size outside; so it is not a constant
    to fit.
    """
    assert atom.inner is not None
    return atom.kind == "abs" and len(atom.inner.terms) == 1


def _collect(terms: list[tuple[tuple[Atom, ...], float]]) -> Expression:
    """Return the sum of terms, with equal products added. Atoms are sorted, and |v|·|v| is written as v·v."""
    size = Atom("abs", Expression.variable(1.0))
    total: dict[tuple[Atom, ...], float] = {}
    for atoms, c in terms:
        pairs = 2 * (atoms.count(size) // 2)
        rest = [atom for atom in atoms if atom != size] + [size] * (atoms.count(size) - pairs)
        product = tuple(sorted([*rest, *[Atom("v")] * pairs], key=repr))
        total[product] = total.get(product, 0.0) + c
    return Expression(tuple(sorted(((a, c) for a, c in total.items() if c != 0.0), key=repr)))


FUNCTIONS = ("Add", "Sub", "Mul", "Tanh", "Abs", "Constant", "Variable")
"""Names of the kinds of nodes, in Operon's terms, of which the search may build an expression's tree."""
DEPTH = 8
"""Largest depth of an expression's tree that the search builds (conventional)."""


@dataclass(frozen=True)
class ScoredExpression:
    """An expression on the Pareto front of length and error.

    length: number of nodes of the tree that Operon found. error: mean square error in the searched data.
    """

    expression: Expression
    length: int
    error: float


def front(
    x: np.ndarray, y: np.ndarray, *, seed: int, population: int, generations: int, length: int, polish: int
) -> tuple[list[ScoredExpression], int]:
    """Search the Pareto front of error and length for y (n,) as a function of x (n,).

    The search is the genetic algorithm NSGA-II (Deb and others, 2002) with subtree crossover; the constants of each new
    expression are fitted by `polish` Levenberg–Marquardt steps, in single precision. It runs on one thread, so that the
    same seed gives the same front. x and y should be of order one. population: number of expressions in a generation.
    generations: largest number of generations. length: largest number of nodes of an expression.

    Returns
    -------
    list of ScoredExpression, int
        The front (not sorted; errors are in units of y²), and the number of models that were evaluated.
    """
    data = op.Dataset(np.asfortranarray(np.column_stack([x, y])))
    columns = sorted(data.Variables, key=lambda column: column.Index)
    rows = op.Range(0, x.size)
    problem = op.Problem(data)
    problem.TrainingRange, problem.TestRange = rows, op.Range(x.size - 1, x.size)
    problem.Target, problem.InputHashes = columns[1], [columns[0].Hash]
    problem.ConfigurePrimitiveSet(sum(int(getattr(op.NodeType, name)) for name in FUNCTIONS))
    budget = 4 * population * generations * (polish + 1)

    # Operon stores pointers to these objects, so each must have a name until the search ends.
    primitives, inputs = problem.PrimitiveSet, problem.InputHashes
    table = op.DispatchTable()
    optimizer = op.LMOptimizer(table, problem, polish, 0)
    coefficient_optimizer = op.CoefficientOptimizer(optimizer)
    error, size = op.Evaluator(problem, table, op.MSE(), False), op.LengthEvaluator(problem)
    both = op.MultiEvaluator(problem)
    for part in (error, size, both):
        part.Budget = budget
    both.Add(error)
    both.Add(size)
    creator = op.BalancedTreeCreator(primitives, inputs, 0.0)
    initial = op.NormalCoefficientInitializer()
    initial.ParameterizeDistribution(0, 1)
    trees = op.UniformLengthTreeInitializer(creator)
    trees.ParameterizeDistribution(2, min(8, length))
    trees.MinDepth, trees.MaxDepth = 1, 1000
    point = op.NormalOnePointMutation()
    point.ParameterizeDistribution(0, 1)
    mutations = [
        point,
        op.ChangeFunctionMutation(primitives),
        op.ReplaceSubtreeMutation(creator, initial, DEPTH, length),
        op.InsertSubtreeMutation(creator, initial, DEPTH, length),
        op.RemoveSubtreeMutation(primitives),
    ]
    mutation = op.MultiMutation()
    for part in mutations:
        mutation.Add(part, 1.0)
    crossover = op.SubtreeCrossover(0.9, DEPTH, length)
    comparison = op.CrowdedComparison()
    mother, father = op.TournamentSelector(comparison), op.TournamentSelector(comparison)
    mother.TournamentSize = father.TournamentSize = 5
    generator = op.BasicOffspringGenerator(both, crossover, mutation, mother, father, coefficient_optimizer)
    reinserter, sorter = op.KeepBestReinserter(comparison), op.RankSorter()
    config = op.GeneticAlgorithmConfig(
        generations=generations,
        max_evaluations=budget,
        local_iterations=polish,
        population_size=population,
        pool_size=population,
        p_crossover=1.0,
        p_mutation=0.25,
        epsilon=1e-6,
        seed=seed,
    )
    search = op.NSGA2Algorithm(config, problem, trees, initial, generator, reinserter, sorter)
    search.Run(op.RandomGenerator(np.uint64(seed)), None, 1, False)

    candidates: list[ScoredExpression] = []
    largest = float(np.abs(x).max())
    for person in search.BestFront:
        tree = person.Genotype
        misfit = np.asarray(op.Evaluate(table, tree, data, rows), float) - y
        expression = _from_postfix(tree.Nodes, largest)
        candidates.append(ScoredExpression(expression, int(tree.Length), float(np.mean(misfit**2))))
    return candidates, int(population * (search.Generation + 1))


def _from_postfix(nodes: list, largest: float) -> Expression:
    """Convert the nodes of Operon's tree, in postfix order, to an expression.

    A node follows its arguments, the first of which is directly before it.

    largest: the largest absolute value of the variable.
    """
    kinds, stack = op.NodeType, []
    grid = np.linspace(-largest, largest, 129)
    for node in nodes:
        if node.IsVariable:
            stack.append(Expression.variable(node.Value))
        elif node.IsConstant:
            stack.append(Expression.constant(node.Value))
        elif node.Type in (kinds.Tanh, kinds.Abs):
            inner = stack.pop()
            kind = "tanh" if node.Type == kinds.Tanh else "abs"
            stack.append(inner.apply(kind, float(np.abs(inner(grid)).max())))
        else:
            value = stack.pop()
            for _ in range(node.Arity - 1):
                other = stack.pop()
                if node.Type == kinds.Mul:
                    value = value * other
                else:
                    value = value + (other.scaled(-1.0) if node.Type == kinds.Sub else other)
            stack.append(value)
    (expression,) = stack
    return expression
