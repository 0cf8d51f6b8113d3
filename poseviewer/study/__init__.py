"""Reliability: from how far off fits end right.

On synthetic and on real photos with known poses.
"""
