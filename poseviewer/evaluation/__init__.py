"""Measure how often fits find the pose, from how far off.

On synthetic and on real photos with known poses.
"""
