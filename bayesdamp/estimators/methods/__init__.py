"""The estimators: one module each, found by name, bound to `PLUGIN`."""
