"""Define `bayesdamp simulate`, which writes a simulated record to try the program on."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from bayesdamp.cli import options as o
from bayesdamp.cli.files import check_replaceable
from bayesdamp.formatting import show
from bayesdamp.interface.signal import Signal
from bayesdamp.interface.simulate import START, simulate as simulate_record
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.restoring import LAWS
from bayesdamp.plugins import read_modules, use_modules
from bayesdamp.store.files import write_bytes
from bayesdamp.types import InputError

FIRST_LINE = "# simulated by bayesdamp\n"
"""First line of a simulated record. A file that begins with it may be overwritten."""
DAMPING_DEFAULTS = {"viscous": 0.1}
"""Default damping: viscous, with a coefficient of 0.1/s, which gives a Q of about 30 at 1 Hz."""
RESTORING_DEFAULTS = {"stiffness": 40.0, "gravity": 4.0, "cubic": 40.0}
"""Default parameters of the restoring laws by name: stiffness in 1/s², gravity in rad/s², cubic in 1/(rad² s²). They
give a frequency of about 1 Hz and visible nonlinearities."""
NOISE_FRACTION = 0.01
"""Default sd of the noise, as a fraction of the amplitude. It is not 0, because models cannot be compared without
noise."""


def parse_pairs(texts: Sequence[str], option: str) -> dict[str, float]:
    """Parse texts such as `a=1,b=2`, the values of a command-line option, to numbers by name.

    `option` is the name of the option, for errors. Empty parts are ignored, and names are not checked. Raises
    InputError for other texts, and for a repeated name.
    """
    values: dict[str, float] = {}
    for part in filter(str.strip, ",".join(texts).split(",")):
        name, _, value = (piece.strip() for piece in part.partition("="))
        try:
            number = float(value)
        except ValueError:
            example = "viscous=0.05" if option == "--damping" else "stiffness=20"
            right = f"it must be NAME=NUMBER, such as {example}"
            raise InputError(f"{option}: is {show(part.strip())}; {right}") from None
        if name in values:
            raise InputError(f"{option}: {name[:40]!r} is given twice; once is enough")
        values[name] = number
    return values


def restoring_defaults(restoring: str) -> dict[str, float]:
    """Return the default parameters of a restoring law (see `RESTORING_DEFAULTS`), by name; {} for an unknown law."""
    needed = LAWS.get(restoring).parameters if restoring in LAWS.names() else ()
    return {name: RESTORING_DEFAULTS[name] for name in needed if name in RESTORING_DEFAULTS}


def defaults_used(damping: Mapping[str, float], other: Mapping[str, float], restoring: str) -> str:
    """Return the default values, other than 0, that a simulation used, as text in the form of command-line options.

    An example is `--damping viscous=0.1 --set stiffness=40,theta0=0.3`. The text is empty if no default was used.

    Parameters
    ----------
    damping, other
        Values that the user gave with --damping and --set, by name.
    restoring
        The restoring law.
    """
    system = restoring_defaults(restoring) | START
    left = {name: value for name, value in system.items() if value and name not in other}
    options = {"--damping": {} if damping else DAMPING_DEFAULTS, "--set": left}
    typed = ((option, [f"{n}={v:g}" for n, v in values.items()]) for option, values in options.items())
    return " ".join(f"{option} {','.join(words)}" for option, words in typed if words)


def suggest_option(option: str) -> str:
    """Return a hint for an unknown option whose name is that of a damping term or of a parameter.

    For example, the hint for `--viscous` is "; it is --damping viscous=NUMBER". The hint is empty for other unknown
    options.
    """
    name = option.lstrip("-").replace("-", "_")
    if name in TERMS.names():
        return f"; it is --damping {name}=NUMBER"
    parameters = {*START, *(p for law in LAWS.names() for p in LAWS.get(law).parameters)}
    return f"; it is --set {name}=NUMBER" if name in parameters else ""


def simulate_with_defaults(
    damping: Mapping[str, float],
    other: Mapping[str, float],
    restoring: str,
    noise_sd: float | None = None,
    **options: Any,
) -> tuple[Signal, float]:
    """Simulate a record with the options of the command; return it and the standard deviation of its noise in rad.

    If no damping is given, `DAMPING_DEFAULTS` are used. Other missing values come from `RESTORING_DEFAULTS`, or else
    are the defaults of `bayesdamp.simulate`.

    Parameters
    ----------
    damping, other
        Values of the options --damping (coefficients by term, and a term's further parameters) and --set, by name.
    restoring
        The restoring law.
    noise_sd
        Standard deviation of the noise in rad; None for 1 % of half the range of the record without noise.
    **options
        Further options of `bayesdamp.simulate`.

    Raises
    ------
    InputError
        If the record cannot be simulated, or if `noise_sd` is None and the oscillator does not move.
    """
    further = {key for name in TERMS.names() for key in TERMS.get(name).further}
    terms = {name: value for name, value in damping.items() if name not in further} or DAMPING_DEFAULTS
    own = {name: value for name, value in damping.items() if name in further}
    values = {**restoring_defaults(restoring), **own, **other}
    make = partial(simulate_record, terms, restoring, **values, **options)
    clean = make()
    if noise_sd is None:
        noise_sd = float(f"{NOISE_FRACTION * np.ptp(clean.y) / 2:.1e}")
        if noise_sd == 0:
            raise InputError(
                "simulate: the oscillator does not move; start it farther from equilibrium, such as --set "
                "theta0=0.5, or reduce its dry friction"
            )
    return make(noise_sd=noise_sd), noise_sd


def as_csv(signal: Signal) -> str:
    """Return a record as the text of a CSV file, with the columns `t (s)` and `angle (rad)`.

    A comment line before the header marks the record as simulated.
    """
    rows = (f"{float(t)!r},{float(y)!r}" for t, y in zip(signal.t, signal.y, strict=True))
    return FIRST_LINE + "\n".join(["t (s),angle (rad)", *rows]) + "\n"


def simulate(
    out: Annotated[Path, typer.Option(help="The CSV file to write.")],
    damping: Annotated[
        list[str] | None,
        typer.Option(
            help="Damping terms with coefficients: viscous=0.05,coulomb=0.03; by default viscous=0.1."
        ),
    ] = None,
    restoring: Annotated[
        str, typer.Option(help="The restoring law: linear, pendulum, duffing, horizontal_pendulum.")
    ] = "linear",
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="Parameters: stiffness=20,theta0=0.2; by default stiffness=40 (1/s², about 1 Hz), "
            "theta0=0.3 (rad), gravity=4, cubic=40 and all others 0.",
        ),
    ] = None,
    duration: Annotated[float, typer.Option(help="Length of the record in s.")] = 20.0,
    samples: Annotated[int, typer.Option(help="Number of samples.")] = 2001,
    noise_sd: Annotated[
        float | None,
        typer.Option(
            help="Standard deviation of the noise, in rad; 1 % of the amplitude by default, 0 for none."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 0,
    plugin: o.Plugins = None,
) -> int:
    """Write a simulated record to try the program on: a CSV of times in s and angles in rad."""
    use_modules(read_modules(plugin or ()))
    terms, system = parse_pairs(damping or [], "--damping"), parse_pairs(set_ or [], "--set")
    record, sd = simulate_with_defaults(
        terms, system, restoring, noise_sd, duration=duration, samples=samples, seed=seed
    )
    content = as_csv(record).encode()
    check_replaceable(out, FIRST_LINE)
    write_bytes(out, content)
    if defaults := defaults_used(terms, system, restoring):
        typer.echo(f"defaults used: {defaults}", err=True)
    if noise_sd is None:
        typer.echo(f"noise: sd {sd:g} rad, 1 % of the amplitude (--noise-sd 0 for none)", err=True)
    typer.echo(out)
    return 0
