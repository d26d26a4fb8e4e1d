"""Records and signals: read, cut out, simulated."""
