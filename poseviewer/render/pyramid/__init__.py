"""Levels of a search: smaller photos and decimated models."""
