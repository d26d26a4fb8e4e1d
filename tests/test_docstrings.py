"""What is public says what it is: ruff's rules on missing docstrings, as the project sets them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
RUFF = (sys.executable, "-m", "ruff", "check", "--no-cache", "--select", "D1", "--ignore", "D105,D107")


def test_everything_public_has_a_docstring() -> None:
    found = subprocess.run([*RUFF, "bayesdamp", "validation"], cwd=ROOT, capture_output=True, text=True)
    assert found.returncode == 0, found.stdout


def test_a_missing_one_is_seen() -> None:
    """The control, by the file's own settings: a public method without one in the package, and none in a test."""
    source = (
        '"""A module."""\n\n\nclass Some:\n    """A class."""\n\n    def method(self):\n        return 1\n'
    )
    for name, missing in (
        ("bayesdamp/some.py", True),
        ("validation/some.py", True),
        ("tests/test_some.py", False),
    ):
        check = [sys.executable, "-m", "ruff", "check", "--no-cache", "--stdin-filename", name, "-"]
        found = subprocess.run(check, cwd=ROOT, input=source, capture_output=True, text=True)
        assert ("D102" in found.stdout) is missing
