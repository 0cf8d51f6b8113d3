"""Reliability and speed of fits, on photos with known poses."""
