"""Poses in the files of other tools, one format a module; ``table`` lists them."""
