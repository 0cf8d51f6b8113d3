"""Levels of a search: smaller photos and lighter models."""
