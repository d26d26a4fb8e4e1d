"""Genetic programming over expressions in one variable, by Operon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyoperon

from bayesdamp.estimators.evolution.expressions import Expression

op: Any = pyoperon  # compiled, and without stubs

FUNCTIONS = ("Add", "Sub", "Mul", "Tanh", "Abs", "Constant", "Variable")
DEPTH = 8


@dataclass(frozen=True)
class Found:
    """An expression, its length in nodes as it was found, and its mean square error there."""

    expression: Expression
    length: int
    error: float


def front(
    x: np.ndarray, y: np.ndarray, *, seed: int, population: int, generations: int, length: int, polish: int
) -> tuple[list[Found], int]:
    """The Pareto front of error and length for y (n,) as a function of x (n,), and the models evaluated.

    NSGA-II (Deb and others, 2002) with subtree crossover; the constants of each offspring take `polish` steps
    of Levenberg–Marquardt, in single precision. One thread: the same seed gives the same front. x and y
    should be of order one.
    """
    data = op.Dataset(np.asfortranarray(np.column_stack([x, y])))
    columns = sorted(data.Variables, key=lambda column: column.Index)
    rows = op.Range(0, x.size)
    problem = op.Problem(data)
    problem.TrainingRange, problem.TestRange = rows, op.Range(x.size - 1, x.size)
    problem.Target, problem.InputHashes = columns[1], [columns[0].Hash]
    problem.ConfigurePrimitiveSet(sum(int(getattr(op.NodeType, name)) for name in FUNCTIONS))
    budget = 4 * population * generations * (polish + 1)

    # Operon holds its parts by pointer: each needs a name that lives until the end.
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

    found: list[Found] = []
    for person in search.BestFront:
        tree = person.Genotype
        misfit = np.asarray(op.Evaluate(table, tree, data, rows), float) - y
        largest = float(np.abs(x).max())
        found.append(Found(_expression(tree.Nodes, largest), int(tree.Length), float(np.mean(misfit**2))))
    return found, int(population * (search.Generation + 1))


def _expression(nodes: list, largest: float) -> Expression:
    """A tree in postfix order as an expression; a node's first argument is the one right before it."""
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
