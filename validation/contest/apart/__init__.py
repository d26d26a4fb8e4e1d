"""Programs of the peers that need other packages. They run in their own environments, without bayesdamp."""
