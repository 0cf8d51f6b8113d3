"""Readers of models; ``assets/docs/formats.md`` says what trimesh reads, and what it gets wrong."""
