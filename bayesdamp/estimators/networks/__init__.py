"""Contain the neural networks and the loss functions of the estimators that train a network. All modules need torch."""
