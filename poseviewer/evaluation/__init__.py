"""Measures of truth: pose errors, synthetic photographs."""
