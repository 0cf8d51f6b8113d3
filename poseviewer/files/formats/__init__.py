"""Poses in the files of other tools; ``known_formats`` lists the formats."""
