"""`bayesdamp simulate`: write a record to try the program on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bayesdamp.cli import options as o
from bayesdamp.cli.simulated import as_csv, defaults_used, parse_pairs, simulated
from bayesdamp.cli.single_file import SIMULATED, SingleFile
from bayesdamp.plugins import read_modules, use


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
    file = SingleFile(out, SIMULATED, "--out", tuple(plugin or ()))
    file.check()
    use(read_modules(plugin or ()))
    terms, system = parse_pairs(damping or [], "--damping"), parse_pairs(set_ or [], "--set")
    record, sd = simulated(terms, system, restoring, noise_sd, duration=duration, samples=samples, seed=seed)
    file.write(as_csv(record))
    if defaults := defaults_used(terms, system, restoring):
        typer.echo(f"defaults used: {defaults}", err=True)
    if noise_sd is None:
        typer.echo(f"noise: sd {sd:g} rad, 1 % of the amplitude (--noise-sd 0 for none)", err=True)
    typer.echo(out)
    return 0
