"""Test the tests: do they fail if an operator, a number or a condition in the code is changed?

`make mutation` changes a copy of the tree, never the tree itself, and runs the tests of the changed part. The changes
are those of Cosmic Ray, except changes of annotations, which are not executed. A change that does not alter the result
counts as not noticed.
"""

from __future__ import annotations

import argparse
import ast
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from validation.scoring import hits_of

ROOT = Path(__file__).resolve().parents[1]
"""Folder of the project."""
TREE = ROOT / ".mutation"
"""Folder of the copy of the project that is changed; it is removed at the end."""
PATIENCE = 10
"""A change also counts as noticed if the tests take more than this many times as long as without it."""


@dataclass(frozen=True)
class Part:
    """A part of the package that is changed, and the tests that must fail then.

    modules: glob patterns, relative to bayesdamp/, of the modules to change. tests: paths of the tests.
    """

    modules: tuple[str, ...]
    tests: tuple[str, ...]


PARTS = {
    "physics": Part(
        ("physics/damping/*.py", "physics/restoring/*.py", "physics/oscillator.py", "physics/orbit.py"),
        ("tests/physics/test_terms_and_laws.py", "tests/physics/test_orbit.py"),
    ),
    "likelihood": Part(
        ("inference/noise/*.py", "inference/model/*.py"), ("tests/inference/noise", "tests/inference/model")
    ),
    "deviation": Part(
        (
            "inference/deviation/linear.py",
            "inference/deviation/repeats.py",
            "inference/deviation/tempered.py",
            "inference/deviation/sampling.py",
            "inference/deviation/slices.py",
        ),
        (
            "tests/inference/deviation/test_hyperparameters.py",
            "tests/inference/deviation/test_linear.py",
            "tests/inference/deviation/test_slices.py",
            "tests/inference/deviation/test_straight.py",
        ),
    ),
    "verdict": Part(("verdict/*.py",), ("tests/verdict",)),
}


def bare(source: str) -> str:
    """Return the source of a module without type annotations, comments and formatting, for comparison."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.arg):
            node.annotation = None
        elif isinstance(node, ast.FunctionDef):
            node.returns = None
        elif isinstance(node, ast.AnnAssign):
            node.annotation = ast.Constant(0)
    return ast.unparse(tree)


def changes(part: Part, seed: int) -> Iterator[tuple[Path, str, str]]:
    """Yield all changes of a part in random order, each as the file and its source before and after."""
    import parso
    from cosmic_ray.mutating import MutationVisitor  # pyright: ignore[reportMissingImports]
    from cosmic_ray.plugins import get_operator, operator_names  # pyright: ignore[reportMissingImports]

    files = sorted({f for glob in part.modules for f in (TREE / "bayesdamp").glob(glob)})
    places: list[tuple[Path, str, int]] = []
    for file in files:
        parsed = parso.parse(file.read_text(encoding="utf-8"))
        for name in (name for name in operator_names() if not get_operator(name).arguments()):
            places += [(file, name, i) for i in range(_count(get_operator(name)(), parsed))]
    for k in np.random.default_rng(seed).permutation(len(places)):
        file, name, occurrence = places[k]
        before = file.read_text(encoding="utf-8")
        after = MutationVisitor.mutate_code(before, get_operator(name)(), occurrence)
        if after is None:
            continue
        try:
            same = bare(before) == bare(after)
        except SyntaxError:
            continue
        if not same:
            yield file, before, after


def _count(operator: Any, node: Any) -> int:
    """Return how many places of a syntax tree an operator of Cosmic Ray (a kind of change) can change."""
    here = len(list(operator.mutation_positions(node)))
    return here + sum(_count(operator, child) for child in getattr(node, "children", ()))


def passes(tests: tuple[str, ...], patience: float | None = None) -> bool:
    """Return whether these tests pass in the copy of the tree, within `patience` seconds (None: without limit)."""
    options = ["-B", "-m", "pytest", "-x", "-n", "0", "-p", "no:cacheprovider", "-m"]
    command = [sys.executable, *options, "not slow", *tests]
    try:
        result = subprocess.run(
            command, cwd=TREE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=patience
        )
        return result.returncode == 0
    except subprocess.TimeoutExpired:
        return False


def try_changes(name: str, count: int, seed: int) -> Iterator[tuple[bool, str]]:
    """Make `count` changes to the part `name` one after the other; yield whether its tests fail, and the changed line.

    Raises SystemExit if the tests fail without a change.
    """
    part = PARTS[name]
    passes(part.tests)  # compiles the kernels, so that the next run is timed without this
    began = time.perf_counter()
    if not passes(part.tests):
        raise SystemExit(f"the tests of {name} fail without any change")
    patience = PATIENCE * (time.perf_counter() - began)
    for file, before, after in islice(changes(part, seed), count):
        file.write_text(after, encoding="utf-8")
        noticed = not passes(part.tests, patience)
        file.write_text(before, encoding="utf-8")
        old, new = before.splitlines(), after.splitlines()
        at = next(i for i, (a, b) in enumerate(zip(old, new, strict=False)) if a != b)
        yield noticed, f"{file.relative_to(TREE)}:{at + 1} {old[at].strip()} -> {new[at].strip()}"


def main() -> None:
    """Run the command line: print each change, and for each part the noticed fraction with its 95 % interval."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40, help="changes of each part")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--parts", nargs="*", default=list(PARTS), choices=list(PARTS))
    options = parser.parse_args()
    shutil.rmtree(TREE, ignore_errors=True)
    shutil.copytree(ROOT, TREE, ignore=shutil.ignore_patterns(".*", "reports", "__pycache__", "_build"))
    for part in options.parts:
        hits, tries = 0, 0
        for noticed, change in try_changes(part, options.count, options.seed):
            hits, tries = hits + noticed, tries + 1
            print("noticed    " if noticed else "NOT NOTICED", change, flush=True)
        print(f"{part}: {hits_of(hits, tries)} are noticed", flush=True)
    shutil.rmtree(TREE)


if __name__ == "__main__":
    main()
