"""With what a run was made: versions, revision, machine, hashes of its inputs."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
import re
import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from bayesdamp.machine.threads import cores


def provenance(inputs: Mapping[str, Path] | None = None, packages: Iterable[str] = ()) -> dict[str, Any]:
    """What run.json says of the program and its inputs.

    inputs: files whose SHA-256 is noted, by the names that they are noted under.
    packages: names of distributions; by default all that bayesdamp requires.
    Returns versions {package: version}, revision, machine {system, processor, cpus, python} and
    inputs {name: hash}.
    """
    return {
        "versions": _versions(packages),
        "revision": _revision(),
        "machine": {
            "system": platform.platform(),
            "processor": _processor(),
            "cpus": cores(),
            "python": platform.python_version(),
        },
        "inputs": {name: sha256(path) for name, path in (inputs or {}).items()},
    }


def sha256(path: Path) -> str:
    """Hexadecimal SHA-256 of a file's content."""
    with Path(path).open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def _versions(packages: Iterable[str]) -> dict[str, str]:
    names = set(packages)
    if not names:
        try:
            required = importlib.metadata.requires("bayesdamp") or []
        except importlib.metadata.PackageNotFoundError:
            required = []
        own = (re.match(r"[\w.-]+", r) for r in required if "extra ==" not in r)
        names = {"bayesdamp", "jaxlib", *(name.group() for name in own if name)}
    found = {}
    for name in sorted(names):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def _revision() -> str:
    """The commit of a checkout ("+changes" where files differ from it), else the package's version."""
    here = Path(__file__)
    package = here.parents[1]

    def git(*arguments: str) -> str:
        done = subprocess.run(
            ["git", "-C", str(package), *arguments], capture_output=True, text=True, check=True, timeout=20
        )
        return done.stdout.strip()

    try:
        # an installed copy may lie inside somebody else's checkout: then this file is not tracked there
        git("ls-files", "--error-unmatch", str(here.relative_to(package)))
        return git("rev-parse", "HEAD") + ("+changes" if git("status", "--porcelain", "--", ".") else "")
    except (OSError, subprocess.SubprocessError):
        return "version " + _versions(["bayesdamp"]).get("bayesdamp", "unknown")


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
