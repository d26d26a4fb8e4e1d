"""The lowest versions that pyproject.toml says are enough, as pip's constraints: `python -m tests.lowest > FILE`."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path

from packaging.requirements import Requirement

PROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"


def lowest(requirements: Iterable[str]) -> Iterator[str]:
    """`name==version` of each that states a least version."""
    for text in requirements:
        one = Requirement(text)
        least = [s.version for s in one.specifier if s.operator == ">="]
        if least:
            yield f"{one.name}=={least[0]}"


def main() -> None:
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    print("\n".join(lowest([*project["dependencies"], *extras["excel"], *extras["parquet"]])))


if __name__ == "__main__":
    main()
