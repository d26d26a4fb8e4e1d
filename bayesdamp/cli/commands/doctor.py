"""Define `bayesdamp doctor`, which checks the installation."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import typer

from bayesdamp.machine import cache_folder, cores

LEAST_MEMORY = 2.0
"""Required memory in GiB; with less, the check of the machine fails. It is twice the 0.95 GiB that a quick comparison
of 2,001 samples on two processes needs (measured)."""
TRUE_RATE, TOLERATED_ERROR = 0.05, 0.1
"""True viscous coefficient in 1/s of the simulated test record, and the relative error of the estimate from which the
installation check fails (conventional)."""


@dataclass(frozen=True)
class CheckResult:
    """The result of one check of the installation.

    what: name of the check, such as "machine". good: whether it succeeded. text: what was found; if the check failed,
    also what to do.
    """

    what: str
    good: bool
    text: str


def cache() -> CheckResult:
    """Check whether the cache folder of compiled code can be written; it is created if it is missing."""
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        return CheckResult("cache", False, f"{folder}: {why}; set BAYESDAMP_CACHE to a folder of your own")
    return CheckResult("cache", True, f"{folder} can be written")


def kernels() -> CheckResult:
    """Load the compiled equations of motion (kernels), or compile them if necessary, and state how long this took."""
    from bayesdamp.physics.kernel.solve import warm

    began = time.perf_counter()
    warm()
    took = time.perf_counter() - began
    return CheckResult("kernels", True, f"ready after {took:.1f} s; later runs load them")


def machine() -> CheckResult:
    """Check whether the machine has at least `LEAST_MEMORY` GiB of physical memory, and state its cores and memory."""
    count = cores()
    if not hasattr(os, "sysconf"):  # on Windows
        return CheckResult("machine", True, f"{count} core{'s' if count > 1 else ''}")
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    enough = memory >= LEAST_MEMORY
    text = f"{count} core{'s' if count > 1 else ''}, {memory:.1f} GiB of memory"
    return CheckResult("machine", enough, text if enough else f"{text}; {LEAST_MEMORY:g} GiB are needed")


def answer() -> CheckResult:
    """Compare viscous with Coulomb damping on a small simulated record, and check the result against the truth.

    The check succeeds if the verdict is viscous damping and its coefficient differs from the true one by less than
    `TOLERATED_ERROR`.
    """
    import bayesdamp as bd

    options = {"stiffness": 20.0, "duration": 10.0, "samples": 200, "noise_sd": 0.003}
    began = time.perf_counter()
    signal = bd.simulate({"viscous": TRUE_RATE}, "linear", seed=1, **options)
    verdict = bd.compare(signal, damping=["viscous", "coulomb"], restoring=["linear"]).verdict
    took = time.perf_counter() - began
    rates = [c.value for c in verdict.coefficients if c.name == "zeta"]
    good = verdict.damping == "viscous" and bool(rates) and abs(rates[0] / TRUE_RATE - 1) < TOLERATED_ERROR
    return CheckResult("answer", good, f"{verdict.sentence or 'none'} ({took:.1f} s)")


CHECKS: tuple[Callable[[], CheckResult], ...] = (machine, cache, kernels, answer)


def run_checks() -> Iterator[CheckResult]:
    """Run each check and yield its result. An exception in a check is reported as a failed check."""
    for function in CHECKS:
        try:
            yield function()
        except Exception as fault:
            yield CheckResult(
                function.__name__, False, f"{type(fault).__name__}: {' '.join(str(fault).split())}"
            )


def doctor() -> int:
    """Check the installation: machine, cache, compiled kernels, and the answer on a small record.

    The versions of libraries are checked by `pip check`.
    """
    good = True
    for check in run_checks():
        typer.echo(f"{'ok' if check.good else 'NO':<4}{check.what:<10} {check.text}")
        good = good and check.good
    return 0 if good else 1
