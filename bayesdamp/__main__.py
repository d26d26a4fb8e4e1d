"""`python -m bayesdamp`: the command line."""

import sys

from bayesdamp.cli.app import main

if __name__ == "__main__":
    sys.exit(main())
