"""Do the tests notice a wrong operator, number or condition? A sample of such changes, each with the tests of its part.

`make mutation` changes a copy of the tree, never the tree itself. Changes are those of Cosmic Ray; what changes
annotations alone is left out, for nothing runs it.
"""

from __future__ import annotations

import argparse
import ast
import csv
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
TREE = ROOT / ".mutation"
OUT = ROOT / "reports" / "mutation"
PATIENCE = 10
"""Times as long as unchanged after which tests that have not ended have noticed."""


@dataclass(frozen=True)
class Part:
    """modules: what is changed, globs in the package; tests: what must notice."""

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
            "inference/deviation/gaussian/*.py",
            "inference/deviation/sampling.py",
            "inference/deviation/ridge.py",
        ),
        (
            "tests/inference/deviation/gaussian",
            "tests/inference/deviation/test_ridge.py",
            "tests/inference/deviation/test_straight.py",
        ),
    ),
    "verdict": Part(("verdict/*.py",), ("tests/verdict",)),
}


@dataclass(frozen=True)
class Mutant:
    """One change: its part, file, line and operator, the line before and after, and whether the tests noticed."""

    part: str
    file: str
    line: int
    operator: str
    before: str
    after: str
    noticed: bool


def bare(source: str) -> str:
    """What runs of a module: without annotations and docstrings."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.arg):
            node.annotation = None
        elif isinstance(node, ast.FunctionDef):
            node.returns = None
        elif isinstance(node, ast.AnnAssign):
            node.annotation = ast.Constant(0)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            node.value = ast.Constant(0)
    return ast.unparse(tree)


def changes(part: Part, seed: int) -> Iterator[tuple[Path, str, int, str, str]]:
    """Changes of a part in random order: file, operator, line, source before and after."""
    import parso
    from cosmic_ray.mutating import MutationVisitor
    from cosmic_ray.plugins import get_operator, operator_names

    files = sorted({f for glob in part.modules for f in (TREE / "bayesdamp").glob(glob)})
    places: list[tuple[Path, str, int, int]] = []
    for file in files:
        parsed = parso.parse(file.read_text(encoding="utf-8"))
        for name in (name for name in operator_names() if not get_operator(name).arguments()):
            places += [(file, name, i, line) for i, line in enumerate(_lines(get_operator(name)(), parsed))]
    for k in np.random.default_rng(seed).permutation(len(places)):
        file, name, occurrence, line = places[k]
        before = file.read_text(encoding="utf-8")
        after = MutationVisitor.mutate_code(before, get_operator(name)(), occurrence)
        if after is None:
            continue
        try:
            same = bare(before) == bare(after)
        except SyntaxError:
            continue
        if not same:
            yield file, name, line, before, after


def _lines(operator: object, node: object) -> list[int]:
    found = [start[0] for start, _ in operator.mutation_positions(node)]  # type: ignore[attr-defined]
    for child in getattr(node, "children", ()):
        found += _lines(operator, child)
    return found


def passes(tests: tuple[str, ...], patience: float | None = None) -> bool:
    """Whether the tests of a part pass in the changed tree, within so many seconds."""
    command = [
        sys.executable,
        "-B",
        "-m",
        "pytest",
        "-x",
        "-n",
        "0",
        "-m",
        "not slow",
        "-p",
        "no:cacheprovider",
        *tests,
    ]
    try:
        done = subprocess.run(
            command, cwd=TREE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=patience
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def tried(name: str, count: int, seed: int) -> Iterator[Mutant]:
    """`count` changes of a part, each tried. Raises SystemExit where the tests fail without any."""
    part = PARTS[name]
    passes(part.tests)  # compiles
    began = time.perf_counter()
    if not passes(part.tests):
        raise SystemExit(f"the tests of {name} fail without any change")
    patience = PATIENCE * (time.perf_counter() - began)
    for _, (file, operator, line, before, after) in zip(range(count), changes(part, seed), strict=False):
        file.write_text(after, encoding="utf-8")
        noticed = not passes(part.tests, patience)
        file.write_text(before, encoding="utf-8")
        old, new = before.splitlines(), after.splitlines()
        at = next((i for i, (a, b) in enumerate(zip(old, new, strict=False)) if a != b), line - 1)
        relative = str(file.relative_to(TREE))
        yield Mutant(name, relative, at + 1, operator, old[at].strip(), new[at].strip(), noticed)


def page(found: list[Mutant], seed: int) -> str:
    """The page: how many were noticed, and what was not."""
    lines = [
        "# Do the tests notice a wrong operator, number or condition?",
        "",
        f"Changes drawn by chance (seed {seed}), each tried with the quick tests of its part alone (`make mutation`).",
        "A change that leaves the meaning as it was counts as not noticed. Intervals are 95 % (Wilson).",
        "",
        "| part | changes | noticed | share |",
        "|---|---|---|---|",
    ]
    for name in PARTS:
        own = [one.noticed for one in found if one.part == name]
        if own:
            low, high = wilson(sum(own), len(own))
            lines.append(
                f"| {name} | {len(own)} | {sum(own)} | {np.mean(own):.2f} ({low:.2f} to {high:.2f}) |"
            )
    lines += ["", "Not noticed:", ""]
    lines += [f"- `{m.file}:{m.line}` `{m.before}` → `{m.after}`" for m in found if not m.noticed]
    return "\n".join(lines) + "\n"


def wilson(k: int, n: int) -> tuple[float, float]:
    """Interval of a share (Wilson 1927)."""
    z = 1.96
    middle, half = (k + z * z / 2) / (n + z * z), z * np.sqrt(k * (n - k) / n + z * z / 4) / (n + z * z)
    return middle - half, middle + half


def main() -> None:
    """Try, and write `mutants.csv` and `README.md` under reports/mutation."""
    ask = argparse.ArgumentParser(description=__doc__)
    ask.add_argument("--count", type=int, default=40, help="changes of each part")
    ask.add_argument("--seed", type=int, default=1)
    ask.add_argument("--parts", nargs="*", default=list(PARTS), choices=list(PARTS))
    asked = ask.parse_args()
    shutil.rmtree(TREE, ignore_errors=True)
    shutil.copytree(ROOT, TREE, ignore=shutil.ignore_patterns(".*", "reports", "__pycache__", "_build"))
    OUT.mkdir(parents=True, exist_ok=True)
    found: list[Mutant] = []
    for part in asked.parts:
        for one in tried(part, asked.count, asked.seed):
            found.append(one)
            print(f"{part} {one.file}:{one.line} {'noticed' if one.noticed else 'NOT NOTICED'}", flush=True)
    with (OUT / "mutants.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [f.name for f in fields(Mutant)], lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(one) for one in found)
    (OUT / "README.md").write_text(page(found, asked.seed), encoding="utf-8")
    shutil.rmtree(TREE)


if __name__ == "__main__":
    main()
