"""Peers that need other packages: programs that run in their own environments, without bayesdamp."""
