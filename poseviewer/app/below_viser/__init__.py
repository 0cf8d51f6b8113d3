"""All code that reaches below viser and websockets.

Each file says what it replaces, why, and the version it was written for: viser 1.1.1 (pinned in
``pyproject.toml``), websockets 16.1. ``tests/app/below_viser/test_viser_inside.py`` fails when a
private name or a signature that is used here changes.
"""
