"""Run the command line: `python -m bayesdamp`."""

import sys

from bayesdamp.cli.app import main

if __name__ == "__main__":
    sys.exit(main())
