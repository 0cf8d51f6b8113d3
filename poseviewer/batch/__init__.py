"""Many photos: rows of a table on all cores.

Or on a cluster; their results, the report, and the review. What cannot be read, fitted or written
raises a BatchError, or the PoseViewerError of its file.
"""
