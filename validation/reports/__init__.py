"""Make the shipped reports, record which code made each of them, and find out which ones are stale."""

from validation.reports.recipes import RECIPES, Recipe
from validation.reports.stamps import Stamp, digest, stale, stamps

__all__ = ["RECIPES", "Recipe", "Stamp", "digest", "stale", "stamps"]
