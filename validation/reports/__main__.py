"""Make the reports whose sources have changed (stale ones): `python -m validation.reports [NAME ...] [--check]`."""

import argparse
import datetime
import os
import shlex
import subprocess
import sys
from pathlib import Path

from bayesdamp.store.files import write_json
from validation.reports.contradictions import contradictions
from validation.reports.recipes import RECIPES, Recipe
from validation.reports.stamps import FILE, digest, stale, stamps

ROOT = Path(__file__).parents[2]
"""Folder of the project."""
WORK = ".reports"
"""Folder for intermediate files of unfinished reports."""
STALE = 1
"""Exit status if a report is stale (its sources have changed since it was made), or if making it failed."""


def main() -> int:
    """Run the command line and return the exit status.

    0: success; 1: a report is stale, or making it failed; 2: an option is wrong, or the tree has uncommitted changes.
    """
    parser = argparse.ArgumentParser(prog="python -m validation.reports", description=__doc__)
    parser.add_argument("names", nargs="*", help="reports to make; by default all stale ones")
    parser.add_argument("--check", action="store_true", help="only list which reports are stale")
    options = parser.parse_args()
    if unknown := sorted(set(options.names) - {r.name for r in RECIPES}):
        parser.error(f"{unknown[0]!r} is not a report; use one of {', '.join(r.name for r in RECIPES)}")
    old = stale(ROOT)
    if options.check:
        stamp_of = stamps(ROOT / "reports")
        for recipe in RECIPES:
            stamp, state = stamp_of.get(recipe.name), "stale" if recipe in old else "fresh"
            origin = f"made {stamp['day']} by {stamp['revision'][:9]}" if stamp else "made by unknown code"
            print(f"{recipe.name:<15} {state:<6} {origin}, about {recipe.cost} min")
        left = sum(recipe.cost for recipe in old)
        print(f"{len(old)} of {len(RECIPES)} are stale; making them takes about {left} minutes on two cores")
        return STALE if old else 0
    if changed := _git("status", "--porcelain", "--", ".", ":!reports"):
        parser.error(f"please commit the changes in the working tree first ({changed.split()[1]})")
    chosen = [r for r in RECIPES if r.name in options.names] if options.names else old
    return 0 if all([_make(recipe) for recipe in chosen]) else STALE


def _make(recipe: Recipe) -> bool:
    """Make a report by the commands of its recipe, and return whether this succeeded.

    The report is stamped as made by this code only if the commands succeed and it does not contradict the truth of its
    simulated records.
    """
    now = digest(recipe, ROOT)
    work, out = ROOT / WORK / f"{recipe.name}-{now[:12]}", ROOT / "reports" / recipe.name
    places = {"python": sys.executable, "work": str(work), "out": str(out)}
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    for command in recipe.commands:
        words = [word.format(**places) for word in shlex.split(command)]
        print(f"{recipe.name}: {' '.join(words)}", flush=True)
        if subprocess.run(words, cwd=ROOT, env=environment).returncode:
            print(f"{recipe.name}: the command failed; the old stamp is unchanged", file=sys.stderr)
            return False
    if wrong := contradictions(out):
        head = f"{recipe.name}: contradicts the truth of its records, so it is not stamped as made"
        print(head, *wrong, sep="\n  ", file=sys.stderr)
        return False
    day = datetime.datetime.now(datetime.UTC).date().isoformat()
    stamp = {"digest": now, "revision": _git("rev-parse", "HEAD"), "day": day}
    stamp_of = stamps(ROOT / "reports") | {recipe.name: stamp}
    write_json(ROOT / "reports" / FILE, dict(sorted(stamp_of.items())))
    return True


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True).stdout.strip()


if __name__ == "__main__":
    raise SystemExit(main())
