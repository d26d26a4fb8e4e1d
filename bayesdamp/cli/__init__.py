"""The command line: one command a file in `commands`, and what they share."""

from bayesdamp.cli.app import main

__all__ = ["main"]
