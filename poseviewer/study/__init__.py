"""Reliability: from how far off a start fits end at the truth, on synthetic and on real photos."""
