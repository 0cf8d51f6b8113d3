"""Fits of the rows of a table, on all cores or on a cluster.

Results, report and review belong to it. A BatchError, or the PoseViewerError of a file, says what
cannot be read, fitted or written.
"""
