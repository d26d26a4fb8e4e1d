"""Inference: posteriors, evidence and checks of models on a record."""
