"""A kernel for damping terms and a restoring law: their forces before the template, compiled once, kept on disk."""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import os
import sys
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from platformdirs import user_cache_dir

from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.restoring import LAWS

FORCES, MARCH, END = "# --- forces ---", "# --- march ---", "# --- end ---"


@dataclass(frozen=True)
class Kernel:
    """Compiled functions of an oscillator with all of `terms` (any may be switched off) under a law."""

    terms: tuple[str, ...]
    restoring: str
    march: Callable[..., Any]


@lru_cache(maxsize=64)
def kernel_of(terms: tuple[str, ...], restoring: str) -> Kernel:
    """The kernel of damping terms and a restoring law, by their names; compiled when it is first called."""
    text = source_of(terms, restoring)
    name = f"bayesdamp_kernel_{hashlib.sha256(text.encode()).hexdigest()[:20]}"
    path = _kept(name, text)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return Kernel(terms, restoring, module.march)


def source_of(terms: tuple[str, ...], restoring: str) -> str:
    """The source of a kernel's module."""
    template = Path(__file__).with_name("march.py").read_text(encoding="utf-8")
    head = "import math\n\nimport numpy as np\nfrom numba import njit\n"
    march = template[template.index(MARCH) : template.index(END)]
    parts, calls, at = [head], [], 0
    for number, name in enumerate(terms):
        term = TERMS.get(name)
        parts.append(_function(term.kernel, f"_shape_{number}"))
        further = getattr(term, "further", ())
        inside = ", ".join(["x", "v", "epsilon", *(f"q[{at + i}]" for i in range(len(further)))])
        at += len(further)
        calls.append(f"    out[{number}] = _shape_{number}({inside}) if active[{number}] else 0.0")
    parts.append("@njit\ndef shapes(x, v, epsilon, q, active, out):\n" + "\n".join(calls) + "\n")
    parts.append(_function(LAWS.get(restoring).kernel, "restoring"))
    return "\n\n".join([*parts, march])


def _function(function: Callable[..., Any], name: str) -> str:
    """The source of a static method as a compiled function of another name."""
    lines = textwrap.dedent(inspect.getsource(function)).splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("def "))
    lines[first] = f"def {name}" + lines[first][lines[first].index("(") :]
    signature = lines[first]
    # Annotations name what the module does not import.
    inside = signature[signature.index("(") + 1 : signature.rindex(")")]
    names = ", ".join(part.partition(":")[0].strip() for part in inside.split(","))
    lines[first] = f"def {name}({names}):"
    return "\n".join(["@njit", *lines[first:]]) + "\n"


def _kept(name: str, text: str) -> Path:
    """The module's file in the user's cache; written whole, so that two processes may do it at once."""
    folder = Path(os.environ.get("BAYESDAMP_CACHE") or user_cache_dir("bayesdamp")) / "kernels"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.py"
    if not path.is_file():
        partial = folder / f"{name}.{os.getpid()}.tmp"
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    return path
