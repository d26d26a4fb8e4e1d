"""Define networks and the losses of the methods that train them. Every module here needs torch."""
