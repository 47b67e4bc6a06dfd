"""Scenes made by rule: graded families for training."""

from hotice.model.generate.families import FAMILIES, family_from_text, family_scenes

__all__ = ["FAMILIES", "family_from_text", "family_scenes"]
