"""The environment that a run was computed in: versions, revision, machine, hashes of its inputs."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
import re
import subprocess
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from bayesdamp import __version__
from bayesdamp.machine import cores


def provenance(inputs: Mapping[str, Path] | None = None, packages: Iterable[str] = ()) -> dict[str, Any]:
    """Return what run.json records of the program and its inputs.

    Parameters
    ----------
    inputs
        Files whose SHA-256 is recorded, by the names that they are recorded under.
    packages
        Names of distributions; by default bayesdamp and all that it requires.

    Returns
    -------
    dict
        versions {package: version}; revision: the commit of a checkout ("+changes" where files differ from it), else
        the package's version; machine {system, processor, cpus, python}; and inputs {name: hash}.
    """
    names, versions = set(packages), dict[str, str]()
    if not names:
        names = {"bayesdamp", "jaxlib"}
        with suppress(importlib.metadata.PackageNotFoundError):
            required = importlib.metadata.requires("bayesdamp") or []
            names |= {re.split(r"[^\w.-]", r)[0] for r in required if "extra ==" not in r}
    for name in sorted(names):
        with suppress(importlib.metadata.PackageNotFoundError):
            versions[name] = importlib.metadata.version(name)
    file = Path(__file__)
    package = file.parents[1]

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(package), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=20).stdout.strip()

    try:
        # an installed copy may lie inside somebody else's checkout: then this file is not tracked there
        git("ls-files", "--error-unmatch", str(file.relative_to(package)))
        revision = git("rev-parse", "HEAD") + ("+changes" if git("status", "--porcelain", "--", ".") else "")
    except (OSError, subprocess.SubprocessError):
        revision = f"version {__version__}"
    processor = platform.processor() or platform.machine()
    with suppress(OSError):
        model = re.search(r"^model name.*?:(.*)$", Path("/proc/cpuinfo").read_text(encoding="utf-8"), re.M)
        processor = model.group(1).strip() if model else processor
    return {
        "versions": versions,
        "revision": revision,
        "machine": {
            "system": platform.platform(),
            "processor": processor,
            "cpus": cores(),
            "python": platform.python_version(),
        },
        "inputs": {name: sha256(path) for name, path in (inputs or {}).items()},
    }


def sha256(path: Path) -> str:
    """Return the hexadecimal SHA-256 of a file's content."""
    with Path(path).open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()
