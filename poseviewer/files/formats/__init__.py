"""Poses in the files of other tools; ``table`` lists the formats."""
