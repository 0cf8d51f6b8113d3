"""Fits of the rows of a table, on all cores or on a cluster."""
