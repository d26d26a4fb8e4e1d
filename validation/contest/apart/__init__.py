"""Programs of the peers that need packages which bayesdamp does not use.

Each runs in a virtual environment of its own, without bayesdamp.
"""
