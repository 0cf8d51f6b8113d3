"""Scenes from files, and start poses from a rectangle, point pairs or wheels."""
