"""Smaller pictures and lighter models: the levels of a search."""
