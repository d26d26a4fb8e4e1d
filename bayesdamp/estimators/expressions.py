"""Search for expressions of the velocity v by genetic programming (the library Operon), as expressions of SymPy.

An expression is a sum of products of v, |…| and tanh(…).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyoperon
import sympy

op: Any = pyoperon  # compiled, and without stubs

V: Any = sympy.Symbol("v", real=True)
"""The velocity in all expressions."""
SMALL = 1e-3
"""tanh(x) is replaced by x if |x| is not larger than this; the relative error is then 3e-7 at most."""


def values_of(expression: Any, v: np.ndarray) -> np.ndarray:
    """Return the values of an expression at velocities v (n,), shape (n,)."""
    return np.zeros_like(v) + sympy.lambdify(V, expression, "numpy")(v)


def without_the_negligible(expression: Any, v: np.ndarray, share: float) -> Any:
    """Return the expression without products whose rms over v (n,) is at most `share` times that of the sum."""
    whole, *sizes = (
        np.sqrt(np.mean(values_of(part, v) ** 2)) for part in (expression, *sympy.Add.make_args(expression))
    )
    terms = zip(sympy.Add.make_args(expression), sizes)
    return sympy.Add(*(term for term, size in terms if size > share * whole))


def widths_of(expression: Any) -> list[float]:
    """Return the width 1/w, in the unit of v, of every factor tanh(w·v), also inside other functions."""
    arguments = (function.args[0].as_coeff_Mul() for function in expression.atoms(sympy.tanh))
    return [1 / float(w) for w, rest in arguments if rest == V]


def text_of(expression: Any) -> str:
    """Return an expression as text, with constants of six digits, such as 0.1·v − 0.05·|v|·v."""
    rounded = expression.xreplace({c: sympy.Float(c, 6) for c in expression.atoms(sympy.Float)})
    named = rounded.replace(sympy.Abs, lambda inner: sympy.Symbol(f"|{text_of(inner)}|"))
    return sympy.sstr(named, full_prec=False).replace("**", "^").replace("*", "·").replace("-", "−")


FUNCTIONS = ("Add", "Sub", "Mul", "Tanh", "Abs", "Constant", "Variable")
"""Names of the kinds of nodes, in Operon's terms, of which the search may build an expression's tree."""
DEPTH = 8
"""Largest depth of an expression's tree that the search builds (conventional)."""


@dataclass(frozen=True)
class ScoredExpression:
    """An expression on the Pareto front of length and error.

    expression: expression of SymPy. length: number of nodes of the tree that Operon found. error: mean square error in
    the searched data.
    """

    expression: Any
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


def _from_postfix(nodes: list, largest: float) -> Any:
    """Convert the nodes of Operon's tree, in postfix order, to an expression of SymPy.

    A node follows its arguments, the first of which is directly before it.

    largest: the largest absolute value of the variable.
    """
    kinds, stack = op.NodeType, []
    grid = np.linspace(-largest, largest, 129)
    for node in nodes:
        arguments = [stack.pop() for _ in range(node.Arity)]
        if node.IsVariable:
            value = float(node.Value) * V
        elif node.IsConstant:
            value = sympy.Float(float(node.Value))
        elif node.Type == kinds.Tanh:
            (inner,) = arguments
            value = inner if np.abs(values_of(inner, grid)).max() <= SMALL else sympy.tanh(inner)
        elif node.Type == kinds.Abs:
            value = sympy.Abs(*arguments)
        elif node.Type == kinds.Mul:
            value = sympy.Mul(*arguments)
        else:
            first, *others = arguments
            value = first - sympy.Add(*others) if node.Type == kinds.Sub else sympy.Add(*arguments)
        stack.append(value)
    (expression,) = stack
    return sympy.expand(expression)
