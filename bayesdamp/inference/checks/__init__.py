"""Whether a model fits, and whether draws may be trusted."""
