"""Test the tests: do they fail if an operator, a number or a condition in the code is changed?

`make mutation` changes a copy of the tree, never the tree itself, and runs the tests of the changed part. The changes
are those of the program Cosmic Ray, except changes of the operator `|`: it occurs mostly in annotations, which are not
executed. A change that cannot alter any result also counts as not noticed.
"""

import argparse
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np

from validation.scoring import hits_of

ROOT = Path(__file__).resolve().parents[1]
"""Folder of the project."""
TREE = ROOT / ".mutation"
"""Folder of the copy of the project that is changed; it is removed at the end."""
TYPES = "BinaryOperator_BitOr_"
"""Kinds of changes whose name (in Cosmic Ray) contains this text are left out: those of the operator `|`."""
PATIENCE = 10
"""A change also counts as noticed if the tests take more than this many times as long as without a change."""


PARTS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "physics": (
        ("physics/damping/*.py", "physics/restoring/*.py", "physics/oscillator.py", "physics/orbit.py"),
        ("tests/physics/test_terms_and_laws.py", "tests/physics/test_orbit.py"),
    ),
    "likelihood": (
        ("inference/noise/*.py", "inference/model/*.py"),
        ("tests/inference/noise", "tests/inference/model"),
    ),
    "deviation": (
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
    "verdict": (("verdict/*.py",), ("tests/verdict",)),
}
"""The parts of the package that are changed, by name. For each: glob patterns of its modules, relative to bayesdamp/,
and the tests that must fail if one of these is changed."""


def changes(modules: Iterable[str]) -> list[Any]:
    """Return all changes that Cosmic Ray can make to modules (glob patterns in bayesdamp/), as its work items."""
    from cosmic_ray.commands import init  # pyright: ignore[reportMissingImports]
    from cosmic_ray.work_db import use_db  # pyright: ignore[reportMissingImports]

    with use_db("changes.sqlite") as session:
        init([file for glob in modules for file in Path("bayesdamp").glob(glob)], session, {})
        items = [item for item in session.work_items if TYPES not in item.mutations[0].operator_name]
    return sorted(items, key=lambda item: str(item.mutations[0]))


def try_changes(part: str, count: int, seed: int) -> Iterator[tuple[bool, str]]:
    """Make random changes one after the other; for each, yield whether the tests fail, and the lines before and after.

    part: name in `PARTS`. count: number of changes. seed: seed of the random choice. Raises CalledProcessError if the
    tests fail without a change.
    """
    from cosmic_ray.mutating import mutate_and_test  # pyright: ignore[reportMissingImports]

    modules, tests = PARTS[part]
    options = ["-m", "pytest", "-x", "-n", "0", "-p", "no:cacheprovider", "-m", "not slow"]
    command = [sys.executable, *options, *tests]
    began = 0.0
    for _ in range(2):  # the first run compiles the kernels, so that the second is timed without this
        began = time.perf_counter()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    patience = PATIENCE * (time.perf_counter() - began)
    items = changes(modules)
    for k in np.random.default_rng(seed).permutation(len(items))[:count]:
        result = mutate_and_test(items[k].mutations, shlex.join(command), patience)
        lines = [line for line in result.diff.splitlines() if re.match(r"[-+](?!-- |\+\+ )|\+\+\+", line)]
        yield result.is_killed, "\n".join(lines)


def main() -> None:
    """Run the command line: print each change, and for each part the noticed fraction with its 95 % interval."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40, help="number of changes in each part")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--parts", nargs="*", default=list(PARTS), choices=list(PARTS))
    options = parser.parse_args()
    shutil.rmtree(TREE, ignore_errors=True)
    shutil.copytree(ROOT, TREE, ignore=shutil.ignore_patterns(".*", "reports", "__pycache__", "_build"))
    with chdir(TREE):
        for name in options.parts:
            results = []
            for noticed, change in try_changes(name, options.count, options.seed):
                results.append(noticed)
                print("noticed" if noticed else "NOT NOTICED", change, flush=True)
            print(f"{name}: {hits_of(sum(results), len(results))} are noticed", flush=True)
    shutil.rmtree(TREE)


if __name__ == "__main__":
    main()
