"""Define `bayesdamp claims`, which tests a published paper's claims about damping estimators on runs of studies."""

from pathlib import Path
from typing import Annotated

import typer

from bayesdamp.claims import CLAIMS
from bayesdamp.claims.judge import TITLE, Runs, page_of_verdicts
from bayesdamp.cli.files import check_replaceable
from bayesdamp.report.results.estimators import error_series
from bayesdamp.report.results.run import RunFolder
from bayesdamp.store.files import write_bytes
from bayesdamp.types import InputError


def claims(
    paper: Annotated[Path | None, typer.Option(help="Folder of a run of studies/paper.toml.")] = None,
    noise: Annotated[
        list[Path] | None, typer.Option(help="Folder of a run of studies/noise*.toml; may be repeated.")
    ] = None,
    out: Annotated[Path, typer.Option(help="The page to write (Markdown).")] = Path("reports/claims.md"),
) -> None:
    """Test a published paper's claims about eleven damping estimators, and report which of them hold."""
    for option, folder in (("--paper", paper), *(("--noise", folder) for folder in noise or ())):
        if folder is not None and not (folder / "run.json").is_file():
            raise InputError(
                f"{option} {folder}: does not contain a run; give the folder that bayesdamp study wrote"
            )
    check_replaceable(out, TITLE)
    runs = Runs(paper, tuple(noise or ()))
    if runs.compared is not None and (
        runs.compared.published.empty or not runs.compared.errors.notna().any(axis=None)
    ):
        what = "is not a run of the paper's study (studies/paper.toml)"
        raise InputError(f"--paper {paper}: {what}; give the folder of bayesdamp study paper")
    for folder in noise or ():
        if not error_series(RunFolder(folder)):
            what = "contains no errors of estimators at several noise levels, sampling rates or lengths of the record"
            raise InputError(f"--noise {folder}: {what}; give the folder of bayesdamp study noise")
    write_bytes(out, page_of_verdicts(CLAIMS, runs).encode(errors="replace"))
    typer.echo(out)
