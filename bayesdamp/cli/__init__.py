"""Define the command line: each command is a module of `commands`, and their common code is here."""

from bayesdamp.cli.app import main

__all__ = ["main"]
