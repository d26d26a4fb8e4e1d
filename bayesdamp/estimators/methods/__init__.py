"""Define the estimators, each in a module of its name that assigns it to `PLUGIN`."""
