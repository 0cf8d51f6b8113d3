"""Attributes and moments of a pose.

Three renderers compute them; overlays and the image pyramid are here as well.
"""
