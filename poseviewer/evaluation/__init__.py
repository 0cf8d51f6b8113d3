"""Measure how often fits find the pose, on synthetic and on real photos with known poses."""
