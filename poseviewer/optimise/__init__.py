"""Minimisers that know no pose."""
