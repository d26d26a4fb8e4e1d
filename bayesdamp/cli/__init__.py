"""Run bayesdamp from the command line: the commands are in `commands`, and what they share is here."""

from bayesdamp.cli.app import main

__all__ = ["main"]
