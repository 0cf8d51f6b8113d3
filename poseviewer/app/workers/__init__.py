"""Computations in threads beside the main loop."""
