"""Networks, and the losses of the methods that train them; every module here needs torch."""
