"""A kernel for damping terms and a restoring law: their forces before the template, compiled once, kept on disk."""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import inspect
import os
import shutil
import sys
import tempfile
import textwrap
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

from bayesdamp.machine import cache_folder
from bayesdamp.physics.damping import EXACT, TERMS, TINY, DampingTerm
from bayesdamp.physics.kernel.differentiate import NoSlopeError, differenced, differentiated
from bayesdamp.physics.restoring import LAWS, RestoringLaw
from bayesdamp.types import Refusal

TEMPLATES, END = ("tangents", "march"), "# --- end ---"
MOST_KEPT = 50
"""Kernels on disk, 0.6 MB each, beyond which those that were not used for longest are removed (conventional)."""
IN_USE = 3600.0
"""Time in s after its last use in which another process may still be compiling a kernel (conventional)."""
_HEAD = f"""import math

import numpy as np
from numba import njit


EXACT, TINY = {EXACT!r}, {TINY!r}


@njit
def _tanh(y):
    return 1.0 - 2.0 / (math.exp(2.0 * y) + 1.0)
"""
_STAMP = (1_000_000_000, 1_000_000_000)
"""Times of every module's file: Numba takes a file of another time for another source, and processes may write it
both at once."""


@dataclass(frozen=True)
class Kernel:
    """Compiled functions of an oscillator with all of `terms` (any may be switched off) under a law."""

    terms: tuple[str, ...]
    restoring: str
    march: Callable[..., Any]
    sums: Callable[..., Any]


def kernel_of(terms: tuple[str, ...], restoring: str) -> Kernel:
    """The kernel of damping terms and a restoring law, by their names; compiled when it is first called.

    Raises Refusal where a term or the law of a user has no `kernel`, or none of which the source is known.
    """
    module = _module(source_of(terms, restoring))
    return Kernel(terms, restoring, module.march, module.sums)


def source_of(terms: tuple[str, ...], restoring: str) -> str:
    """The source of a kernel's module."""
    parts, calls, sums, slopes, at = [_HEAD], [], [], [], 0
    owners, switches, jumps = list[int](), list[bool](), list[bool]()
    for number, name in enumerate(terms):
        term = TERMS.get(name)
        _own(term, DampingTerm, f"damping term {name!r}")
        parts.append(_function(term.kernel, f"_shape_{number}", f"damping term {name!r}"))
        further = [f"q[{at + i}]" for i in range(len(term.further))]
        inside = ", ".join(["x", "v", "rounding" if term.rounded else "epsilon", *further])
        slope, changes = _slopes_of_term(parts[-1], number, len(further))
        parts.append(slope)
        owners += [number] * len(further)
        switches.append(bool(term.switches))
        jumps.append(bool(term.switches and not term.rounded))
        sums.append(f"    if c[{number}] != 0.0:\n        total += c[{number}] * _shape_{number}({inside})")
        calls.append(f"    out[{number}] = _shape_{number}({inside}) if active[{number}] else 0.0")
        found = ", ".join(["f", "by_x", "by_v", *(f"by_{i}" for i in range(len(further)))])
        slopes += [
            f"    if active[{number}]:",
            f"        {found} = _slopes_{number}({inside}{changes})",
            f"        out[{2 + number}] = share * f",
            f"        total, x_slope, v_slope = (total + c[{number}] * f, x_slope + c[{number}] * by_x, "
            f"v_slope + c[{number}] * by_v)",
            *(
                f"        out[{2 + len(terms) + at + i}] = share * c[{number}] * by_{i}"
                for i in range(len(further))
            ),
        ]
        at += len(further)
    parts.append(f"OWNERS = np.array({owners}, np.int64)\nSWITCHES = np.array({switches}, np.bool_)\n")
    parts.append(f"JUMPS = np.array({jumps}, np.bool_)\n")
    parts.append("@njit\ndef shapes(x, v, epsilon, rounding, q, active, out):\n" + "\n".join(calls) + "\n")
    parts.append(
        "@njit\ndef damping(x, v, epsilon, rounding, q, c):\n    total = 0.0\n"
        + "\n".join(sums)
        + "\n    return total\n"
    )
    parts.append(
        "@njit\ndef damping_slopes(x, v, epsilon, rounding, q, c, active, sizes, share, out):\n"
        "    total, x_slope, v_slope = 0.0, 0.0, 0.0\n"
        + "\n".join(slopes)
        + "\n    return total, x_slope, v_slope\n"
    )
    law = LAWS.get(restoring)
    _own(law, RestoringLaw, f"restoring law {restoring!r}")
    parts.append(_function(law.kernel, "restoring", f"restoring law {restoring!r}"))
    parts += _slopes_of_law(parts[-1], len(law.parameters))
    acting = [f"coefficients[{i}] if active[{i}] else 0.0" for i in range(len(terms))]
    further, rests = [f"q[{i}]" for i in range(at)], [f"law[{i}]" for i in range(len(law.parameters))]
    tuples = ", ".join(f"({', '.join([*each, '0.0'])})" for each in (acting, further, rests))
    parts.append(f"@njit\ndef gathered(coefficients, q, active, law):\n    return {tuples}\n")
    return "\n\n".join([*parts, *map(_template, TEMPLATES)])


def _slopes_of_term(source: str, number: int, further: int) -> tuple[str, str]:
    """The function of a term's value and slopes by x, v and its further parameters, and what a call passes besides."""
    given, name = _arguments(source), f"_slopes_{number}"
    try:
        return differentiated(source, name, [*given[:2], *given[3:]]), ""
    except NoSlopeError:
        q = [f"q{i}" for i in range(further)]
        call = f"_shape_{number}({{x}}, {{v}}, epsilon{''.join(f', {{{one}}}' for one in q)})"
        changes = {"x": "1e-6 * sizes[0]", "v": "1e-6 * sizes[1]"}
        changes |= {one: f"1e-6 * (abs({one}) + 1e-3)" for one in q}
        return differenced(call, ["x", "v", "epsilon", *q, "sizes"], changes, name), ", sizes"


def _slopes_of_law(source: str, count: int) -> list[str]:
    """`restoring_slopes`, and the function that it calls for the law's value and slopes by x and its parameters."""
    x, p = _arguments(source)
    try:
        own, changes = differentiated(source, "_law_slopes", [x, *(f"{p}[{i}]" for i in range(count))]), ""
    except NoSlopeError:
        numbers = [f"p{i}" for i in range(count)]
        call = f"restoring({{x}}, ({', '.join(f'{{{one}}}' for one in [*numbers])}, 0.0))"
        moved = {"x": "1e-6 * sizes[0]"}
        moved |= {one: f"1e-6 * (abs({one}) + sizes[{2 + i}])" for i, one in enumerate(numbers)}
        inner = differenced(call, ["x", *numbers, "sizes"], moved, "_law_numbers")
        given = ", ".join(["x", *(f"p[{i}]" for i in range(count)), "sizes"])
        own = f"{inner}\n\n@njit\ndef _law_slopes(x, p, sizes):\n    return _law_numbers({given})\n"
        changes = ", sizes"
    found = ", ".join(["f", "by_x", *(f"by_{i}" for i in range(count))])
    kept = "".join(f"    out[first + {i}] = share * by_{i}\n" for i in range(count))
    return [
        own,
        "@njit\ndef restoring_slopes(x, p, sizes, share, out, first):\n"
        f"    {found} = _law_slopes(x, p{changes})\n{kept}    return f, by_x\n",
    ]


def _arguments(source: str) -> list[str]:
    """Names of the arguments of the function of a source."""
    function = ast.parse(source).body[0]
    assert isinstance(function, ast.FunctionDef)
    return [a.arg for a in (*function.args.posonlyargs, *function.args.args)]


@cache
def _template(name: str) -> str:
    template = Path(__file__).with_name(f"{name}.py").read_text(encoding="utf-8")
    return template[template.index(f"# --- {name} ---") : template.index(END)]


def _own(plugin: DampingTerm | RestoringLaw, base: type, what: str) -> None:
    if type(plugin).kernel is base.kernel:  # type: ignore[attr-defined]
        raise Refusal(f"the {what} has no `kernel`, of which compiled trajectories are made")


@lru_cache(maxsize=256)
def _function(function: Callable[..., Any], name: str, what: str) -> str:
    """The source of a static method as a compiled function of another name.

    Annotations and defaults go, for they name what the kernel's module does not import.
    """
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, SyntaxError):
        raise Refusal(f"the {what} has a `kernel` whose source cannot be read") from None
    found = tree.body[0]
    if not isinstance(found, ast.FunctionDef):
        raise Refusal(f"the {what} has a `kernel` that is not a plain function")
    foreign = sorted(set(function.__code__.co_names) & set(function.__globals__) - {"math", "np"})
    if foreign:
        raise Refusal(
            f"the {what} has a `kernel` that uses {foreign[0]!r}: it may use its arguments, math and np"
        )
    found.name, found.returns, found.decorator_list = name, None, [ast.Name("njit", ast.Load())]
    for argument in [*found.args.posonlyargs, *found.args.args]:
        argument.annotation = None
    found.args.defaults = []
    return ast.unparse(ast.fix_missing_locations(_Quick().visit(found))) + "\n"


class _Quick(ast.NodeTransformer):
    """The hyperbolic tangent by an exponential, in a third of the time: right to 2e-16 of its largest value."""

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """math.tanh becomes _tanh."""
        if isinstance(node.value, ast.Name) and (node.value.id, node.attr) == ("math", "tanh"):
            return ast.Name("_tanh", ast.Load())
        return self.generic_visit(node)


@lru_cache(maxsize=64)
def _module(text: str) -> ModuleType:
    """The module with this source, imported from the folder where it and its machine code are kept."""
    name = f"bayesdamp_kernel_{hashlib.sha256(text.encode()).hexdigest()[:20]}"
    spec = importlib.util.spec_from_file_location(name, _kept(name, text))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def _kept(name: str, text: str) -> Path:
    """The module's file, in a folder of its own: in the user's cache, in a temporary one where none can be written."""
    home = cache_folder() / "kernels"
    try:
        path = _written(home / name, text)
        _evict(home)
    except OSError:
        path = _written(_temporary() / name, text)
    return path


def _written(folder: Path, text: str) -> Path:
    """The source in a folder, written whole, as two processes may do it at once; the folder's time is its last use."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "kernel.py"
    if not path.is_file():
        partial = folder / f".{uuid.uuid4().hex}.tmp"
        partial.write_text(text, encoding="utf-8")
        os.utime(partial, _STAMP)
        partial.replace(path)
    os.utime(folder)
    if not os.access(folder, os.W_OK):
        raise PermissionError(f"{folder} is not writable")
    return path


def _evict(home: Path) -> None:
    """Remove the kernels that were not used for longest, those in use never."""
    folders = sorted(home.glob("bayesdamp_kernel_*"), key=lambda folder: folder.stat().st_mtime)
    for folder in folders[: max(len(folders) - MOST_KEPT, 0)]:
        if time.time() - folder.stat().st_mtime > IN_USE:
            shutil.rmtree(folder, ignore_errors=True)


@cache
def _temporary() -> Path:
    """A folder of this process, for kernels that can be kept nowhere else."""
    import atexit

    folder = Path(tempfile.mkdtemp(prefix="bayesdamp-kernels-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
