"""Readers of camera files: one format a file."""
