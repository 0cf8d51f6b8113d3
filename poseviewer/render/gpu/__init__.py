"""Moments on a GPU by wgpu: many poses in one submission, without reading pictures back."""
