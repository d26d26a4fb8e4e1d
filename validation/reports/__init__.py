"""The shipped reports: how each is made, by which code it was, and which of them are stale."""

from validation.reports.recipes import RECIPES, Recipe
from validation.reports.stamps import Stamp, digest, stale, stamps

__all__ = ["RECIPES", "Recipe", "Stamp", "digest", "stale", "stamps"]
