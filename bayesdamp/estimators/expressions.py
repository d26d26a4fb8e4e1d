"""Search for formulas of a damping force as a function of the velocity v, by genetic programming with Operon.

Each result is an expression of the library SymPy: a sum of products of constants, v, |…| and tanh(…).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyoperon
import sympy
from pyoperon.sklearn import SymbolicRegressor

op: Any = pyoperon  # compiled, and without stubs

V: Any = sympy.Symbol("v", real=True)
"""SymPy symbol of the velocity, the only variable in all expressions."""
SMALL = 1e-3
"""In an expression, tanh(x) is replaced by x if |x| is at most this at all velocities of the data. The relative error
is then at most 3e-7."""


def values_of(expression: Any, v: np.ndarray) -> np.ndarray:
    """Evaluate a SymPy expression of the velocity at the velocities v (n,), and return its values, (n,)."""
    return np.zeros_like(v) + sympy.lambdify(V, expression, "numpy")(v)


def without_the_negligible(expression: Any, v: np.ndarray, share: float) -> Any:
    """Return the expression without those of its additive terms that are negligible at the velocities v (n,).

    A term is dropped if its rms over v is at most `share` times the rms of the whole expression.
    """
    terms = sympy.Add.make_args(expression)
    whole, *sizes = (np.sqrt(np.mean(values_of(part, v) ** 2)) for part in (expression, *terms))
    return sympy.Add(*(term for term, size in zip(terms, sizes) if size > share * whole))


def text_of(expression: Any) -> str:
    """Return an expression as text, with six significant digits, such as 0.1·v − 0.05·|v|·v."""
    rounded = expression.xreplace({c: sympy.Float(c, 6) for c in expression.atoms(sympy.Float)})
    named = rounded.replace(sympy.Abs, lambda inner: sympy.Symbol(f"|{text_of(inner)}|"))
    return sympy.sstr(named, full_prec=False).replace("**", "^").replace("*", "·").replace("-", "−")


MUTATIONS = ("onepoint", "changefunc", "replacesubtree", "insertsubtree", "removesubtree")
"""Operon's names of the random changes (mutations) of an expression in the search; all have the same probability."""
DEVIATION = 0.4
"""Standard deviation σ of the Gaussian likelihood with which Operon measures the error of an expression. For any σ it
ranks expressions like the mean square error. With this σ the constant of the likelihood, ln(2πσ²)/2 per sample, is
about 0, so that single precision resolves small errors."""
DEPTH = 8
"""Largest depth of the tree of operations that represents an expression in the search (conventional)."""


@dataclass(frozen=True)
class ScoredExpression:
    """An expression on the Pareto front: no other expression found by the search is both shorter and more accurate.

    expression: the SymPy expression of v. length: number of nodes of its tree as Operon found it. error: mean square
    error on the data of the search, in their squared unit.
    """

    expression: Any
    length: int
    error: float


def front(
    x: np.ndarray, y: np.ndarray, *, seed: int, population: int, generations: int, length: int, polish: int
) -> tuple[list[ScoredExpression], int]:
    """Search for expressions that describe y (n,) as a function of x (n,), and return those on the Pareto front.

    On this front no expression is both shorter and more accurate than another. The search is the genetic algorithm
    NSGA-II (Deb and others, 2002) with subtree crossover. The constants of each new expression are fitted by `polish`
    Levenberg–Marquardt steps, in single precision. The search runs on one thread, so that the same seed gives the same
    front. x and y should be of order one. population: number of expressions in a generation. generations: largest
    number of generations. length: largest number of nodes in the tree of an expression.

    Returns
    -------
    list of ScoredExpression, int
        The expressions on the front (not sorted; errors are in units of y²), and the number of evaluated expressions.
    """
    search = SymbolicRegressor(
        allowed_symbols="add,sub,mul,tanh,abs,constant,variable",
        mutation=dict.fromkeys(MUTATIONS, 1.0),
        objectives=["gauss", "length"],
        uncertainty=[DEVIATION],
        population_size=population,
        generations=generations,
        max_evaluations=4 * population * generations * (polish + 1),
        max_length=length,
        max_depth=DEPTH,
        initialization_max_length=8,
        optimizer_iterations=polish,
        epsilon=1e-6,
        add_model_scale_term=False,
        add_model_intercept_term=False,
        random_state=seed,
    ).fit(x[:, None], y)
    largest = float(np.abs(x).max())
    members = [
        ScoredExpression(_from_postfix(m["tree"].Nodes, largest), m["length"], m["mean_squared_error"])
        for m in search.pareto_front_
    ]
    return members, int(population * (search.stats_["generations"] + 1))


def _from_postfix(nodes: list, largest: float) -> Any:
    """Convert the nodes of Operon's tree, in postfix order, to an expression of SymPy.

    In this order a node follows its arguments; its first argument is directly before it. largest: largest absolute
    value of the variable in the data; it decides where tanh(x) is replaced by x (`SMALL`).
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
