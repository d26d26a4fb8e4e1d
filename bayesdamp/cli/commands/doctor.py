"""`bayesdamp doctor`: is everything there, and does it answer?"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version

import typer

from bayesdamp.machine import cache_folder

LEAST_MEMORY = 2.0
"""GiB: twice the 0.95 that a quick comparison of 2,001 samples on two processes takes (measured)."""
TRUTH, WITHIN = 0.05, 0.1
"""Decay rate in 1/s of the record that is answered, and how far off the answer may be, relative (conventional)."""


@dataclass(frozen=True)
class Finding:
    """One line: what was looked at, whether it is well, and what there is (or what would mend it)."""

    what: str
    well: bool
    said: str


def packages() -> Finding:
    """The libraries that are needed, against the ranges that the package states."""
    from packaging.requirements import Requirement

    try:
        needed = [Requirement(text) for text in requires("bayesdamp") or ()]
    except PackageNotFoundError:
        return Finding("libraries", False, "bayesdamp is not installed; pip install -e . in its folder")
    wrong, right = [], 0
    for one in needed:
        if one.marker is not None and not one.marker.evaluate({"extra": ""}):
            continue
        try:
            own = version(one.name)
        except PackageNotFoundError:
            wrong.append(f"{one.name} is missing ({one.specifier})")
            continue
        if one.specifier.contains(own, prereleases=True):
            right += 1
        else:
            wrong.append(f"{one.name} is {own}, wanted {one.specifier}")
    return Finding("libraries", not wrong, "; ".join(wrong) or f"{right}, all within their ranges")


def cache() -> Finding:
    """The folder of compiled programs."""
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        return Finding("cache", False, f"{folder}: {why}; set BAYESDAMP_CACHE to a folder of your own")
    return Finding("cache", True, f"{folder} can be written")


def kernels() -> Finding:
    """The compiled kernels, made where they are not there yet."""
    from bayesdamp.physics.kernel.warm import warm

    began = time.perf_counter()
    warm()
    took = time.perf_counter() - began
    return Finding("kernels", True, f"ready after {took:.1f} s; later runs load them")


def machine() -> Finding:
    """Cores and memory (GiB) that this process may use."""
    from bayesdamp.machine.threads import cores

    found = cores()
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    well = memory >= LEAST_MEMORY
    said = f"{found} core{'s' if found > 1 else ''}, {memory:.1f} GiB of memory"
    return Finding("machine", well, said if well else f"{said}; {LEAST_MEMORY:g} are needed")


def answer() -> Finding:
    """A small record with a known truth, answered."""
    import bayesdamp as bd

    made = {"stiffness": 20.0, "duration": 10.0, "samples": 200, "noise_sd": 0.003}
    began = time.perf_counter()
    signal = bd.simulate({"viscous": TRUTH}, "linear", seed=1, **made)
    found = bd.compare(signal, damping=["viscous", "coulomb"], restoring=["linear"]).verdict
    took = time.perf_counter() - began
    rates = [c.value for c in found.coefficients if c.name == "zeta"]
    well = found.damping == "viscous" and bool(rates) and abs(rates[0] / TRUTH - 1) < WITHIN
    return Finding("answer", well, f"{found.sentence or 'none'} ({took:.1f} s)")


CHECKS: tuple[Callable[[], Finding], ...] = (packages, machine, cache, kernels, answer)


def findings(checks: tuple[Callable[[], Finding], ...] = CHECKS) -> Iterator[Finding]:
    """Each check's finding; a fault in one is its finding."""
    for check in checks:
        try:
            yield check()
        except Exception as fault:
            yield Finding(check.__name__, False, f"{type(fault).__name__}: {' '.join(str(fault).split())}")


def doctor() -> int:
    """Check the installation: versions, cache, compiled kernels, machine, and a small record answered."""
    well = True
    for one in findings():
        typer.echo(f"{'ok' if one.well else 'NO':<4}{one.what:<10} {one.said}")
        well = well and one.well
    return 0 if well else 1
