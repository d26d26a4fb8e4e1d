"""Describe the environment of a run: versions, revision, machine and hashes of the input files."""

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
    """Return the description of program, machine and inputs for run.json.

    Parameters
    ----------
    inputs
        Input files, by the names under which their SHA-256 is stated.
    packages
        Names of packages whose versions are stated; by default bayesdamp and its requirements. A package that is not
        installed is left out.

    Returns
    -------
    dict
        versions: {package: version}. revision: the commit of a checkout, with "+changes" if files differ from it; else
        the version of the package. machine: {system, processor, cpus, python}. inputs: {name: hash}.
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
        # An installed copy may be inside the checkout of another project, in which this file is not tracked.
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
