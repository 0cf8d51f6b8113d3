"""Attributes and moments of a pose.

Three renderers give them; overlays and the image pyramid are here as well.
"""
