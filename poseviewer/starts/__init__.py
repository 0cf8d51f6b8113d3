"""Scenes from files, start poses from a rectangle, point pairs or wheels, and measurements."""
