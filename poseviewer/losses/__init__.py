"""Losses that a search can minimise, a file for each, and the table of them."""
