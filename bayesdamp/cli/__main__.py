"""Run `python -m bayesdamp.cli` as `bayesdamp` itself."""

import sys

from bayesdamp.cli.app import main

sys.exit(main())
