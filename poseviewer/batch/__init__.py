"""Many photos: rows of a table on all cores or on a cluster, their report and their review.

What cannot be read, fitted or written raises a BatchError, or the PoseViewerError of its file.
"""
