"""Define `bayesdamp doctor`, which checks the installation."""

import os
import tempfile
import time
from collections.abc import Callable

import typer

from bayesdamp.machine import cache_folder, cores
from bayesdamp.types import InputError

LEAST_MEMORY = 2.0
"""Required memory in GiB; with less, the check of the machine fails. It is twice the 0.95 GiB that a quick comparison
of 2,001 samples on two processes needs (measured)."""
TRUE_RATE, TOLERATED_ERROR = 0.05, 0.1
"""True viscous coefficient in 1/s of the simulated test record, and the relative error of the estimate from which the
installation check fails (conventional)."""


def machine() -> str:
    """Check that the machine has at least `LEAST_MEMORY` GiB of physical memory.

    Return a text with the cores and the memory; raise InputError if the memory is too small. On Windows the memory is
    not checked.
    """
    text = f"{cores()} core{'s' if cores() > 1 else ''}"
    if hasattr(os, "sysconf"):  # not on Windows
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
        text += f", {memory:.1f} GiB of memory"
        if memory < LEAST_MEMORY:
            raise InputError(f"{text}; {LEAST_MEMORY:g} GiB are needed")
    return text


def cache() -> str:
    """Check that the cache folder of compiled code can be written; it is created if it is missing.

    Return a text with the folder; raise InputError if it cannot be written.
    """
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise InputError(f"{folder}: {why}; set BAYESDAMP_CACHE to a folder of your own") from None
    return f"{folder} can be written"


def kernels() -> str:
    """Load the compiled equations of motion (kernels), or compile them if necessary.

    Return a text with the time that this took.
    """
    from bayesdamp.physics.kernel.solve import warm

    began = time.perf_counter()
    warm()
    return f"ready after {time.perf_counter() - began:.1f} s; later runs load them"


def answer() -> str:
    """Compare viscous with Coulomb damping on a small simulated record, and check the result against the truth.

    Return the sentence of the verdict and the duration as text. Raise InputError unless the verdict is viscous damping,
    with a coefficient that differs from the true one by less than `TOLERATED_ERROR` (relative).
    """
    import bayesdamp as bd

    options = {"stiffness": 20.0, "duration": 10.0, "samples": 200, "noise_sd": 0.003}
    began = time.perf_counter()
    signal = bd.simulate({"viscous": TRUE_RATE}, "linear", seed=1, **options)
    verdict = bd.compare(signal, damping=["viscous", "coulomb"], restoring=["linear"]).verdict
    text = f"{verdict.sentence or 'none'} ({time.perf_counter() - began:.1f} s)"
    rates = [c.value for c in verdict.coefficients if c.name == "zeta"]
    if verdict.damping != "viscous" or not rates or abs(rates[0] / TRUE_RATE - 1) >= TOLERATED_ERROR:
        raise InputError(text)
    return text


CHECKS: tuple[Callable[[], str], ...] = (machine, cache, kernels, answer)
"""The checks of the installation, in their order. Each returns a text with its result if the check passes. Otherwise it
raises an exception: an InputError for an expected failure, whose message is shown without the name of its class."""


def doctor() -> int:
    """Check the installation: machine, cache, compiled kernels, and the answer on a small record.

    The versions of libraries are checked by `pip check`.
    """
    status = 0
    for check in CHECKS:
        try:
            mark, text = "ok", check()
        except Exception as fault:
            kind = "" if isinstance(fault, InputError) else f"{type(fault).__name__}: "
            mark, text, status = "NO", f"{kind}{' '.join(str(fault).split())}", 1
        typer.echo(f"{mark:<4}{check.__name__:<10} {text}")
    return status
