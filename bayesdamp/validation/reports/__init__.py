"""The shipped reports: how each is made, by which code it was, and which of them are stale."""

from bayesdamp.validation.reports.recipes import RECIPES, Recipe
from bayesdamp.validation.reports.stamps import Stamp, digest, stale, stamps

__all__ = ["RECIPES", "Recipe", "Stamp", "digest", "stale", "stamps"]
