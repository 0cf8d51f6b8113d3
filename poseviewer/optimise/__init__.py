"""Minimisers that know no pose: ``protocol.Minimiser`` says what all of them have in common."""
