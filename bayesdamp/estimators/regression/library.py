"""The candidate terms of the paper's sections 3.4 and 3.12, and how a model's parameters are read off them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from bayesdamp.estimators.shared import known_restoring, oscillator, solved
from bayesdamp.physics.damping import PAPER_TERMS, TERMS
from bayesdamp.types import OK, Problem

WRITTEN = {"viscous": "2θ̇", "coulomb": "tanh(θ̇/ε)", "quadratic": "θ̇|θ̇|"}
"""How a damping term's shape is written; another term by its name."""


@dataclass(frozen=True)
class Candidate:
    """One function of displacement and velocity, both (n,), in a library.

    damping: name of the damping term whose shape it is. restoring: whether it
    depends on θ alone. jumps: whether it jumps where the velocity changes sign.
    """

    name: str
    function: Callable[[np.ndarray, np.ndarray], np.ndarray]
    damping: str | None = None
    restoring: bool = False
    jumps: bool = False


def candidates(
    problem: Problem, epsilon: float, unit: str, scales: Mapping[str, float], mixed: bool = False
) -> list[Candidate]:
    """The library: damping shapes (the paper's and the problem's own), then functions of θ.

    epsilon: width of friction's switch in rad/s, 0 for the sign. A record in metres has no cos θ and sin θ.
    scales: what terms take that is no parameter. mixed: also θ̇² and θθ̇, which multiply noise with noise.
    """
    found = []
    for name in dict.fromkeys((*PAPER_TERMS, *problem.damping)):
        term = TERMS.get(name)
        written = "sign(θ̇)" if name == "coulomb" and epsilon == 0.0 else WRITTEN.get(name, name)
        further = [scales[n] for n in term.further]
        shape = lambda x, v, term=term, q=further: np.asarray(term.force(x, v, epsilon, *q))  # noqa: E731
        found.append(Candidate(written, shape, damping=name, jumps=term.switches and epsilon == 0.0))
    only: list[tuple[str, Callable[[np.ndarray], np.ndarray]]] = [
        ("1", np.ones_like),
        ("θ", lambda x: x),
        ("cos θ", np.cos),
        ("sin θ", np.sin),
        ("θ²", lambda x: x**2),
        ("θ³", lambda x: x**3),
    ]
    for name, f in only:
        if unit == "rad" or name not in ("cos θ", "sin θ"):
            found.append(Candidate(name, lambda x, v, f=f: f(x), restoring=True))
    if mixed:
        found.append(Candidate("θ̇²", lambda x, v: v**2))
        found.append(Candidate("θθ̇", lambda x, v: x * v))
    return found


def restoring_values(problem: Problem, theta: np.ndarray, force: np.ndarray) -> dict[str, float]:
    """The free restoring parameters whose law is nearest to a found force beyond what is known of it.

    theta, force: displacements and the found force there less the known part, each (n,).
    """
    form = oscillator(problem).law.linear_form(theta, known_restoring(problem))
    if form.columns.shape[1] == 0:
        return {}
    return form.decode(solved(form.columns, force, 1e-12))


def damping_values(
    problem: Problem, library: list[Candidate], x: np.ndarray, stderr: np.ndarray
) -> tuple[dict[str, float], dict[str, float]]:
    """Return the problem's damping coefficients and their standard errors by name, from those of the library, (p,)."""
    index = {one.damping: i for i, one in enumerate(library) if one.damping}
    terms = oscillator(problem).terms
    values, errors = ({t.parameter: float(each[index[t.name]]) for t in terms} for each in (x, stderr))
    return values, errors


def judged(library: list[Candidate], selected: np.ndarray, model: np.ndarray) -> str:
    """ok where a sparse regression selects the model's damping terms and nothing that the model does not have, or
    a sentence. selected: (p,) of bool; model: what it may select, (p,) of bool."""
    names = [one.name for one in library]
    kept = ", ".join(n for n, s in zip(names, selected) if s) or "nothing"
    missing = [n for n, one, m, s in zip(names, library, model, selected) if one.damping and m and not s]
    strange = [n for n, m, s in zip(names, model, selected) if s and not m]
    said = [f"leaves out the model's {' and '.join(missing)}"] if missing else []
    said += [f"the model has no {' or '.join(strange)}"] if strange else []
    return (
        f"the sparse regression selects {kept}: it {'; '.join(said)}".replace("it the", "the") if said else OK
    )
