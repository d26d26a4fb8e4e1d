"""`python -m bayesdamp`, the same as `bayesdamp`."""

import sys

from bayesdamp.cli import main

if __name__ == "__main__":  # a worker that is spawned imports this under another name
    sys.exit(main())
