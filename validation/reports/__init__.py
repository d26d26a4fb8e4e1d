"""Make the shipped reports: how each is made, which code made it, and which reports are stale."""

from validation.reports.recipes import RECIPES, Recipe
from validation.reports.stamps import Stamp, digest, stale, stamps

__all__ = ["RECIPES", "Recipe", "Stamp", "digest", "stale", "stamps"]
