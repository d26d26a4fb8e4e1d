"""Numbers with intervals from draws: ratios against amplitude, shares of the energy, bounds of what is absent."""
