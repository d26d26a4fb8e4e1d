"""Contain the estimators. Each module defines one estimator with the name of the module, and assigns it to `PLUGIN`."""
