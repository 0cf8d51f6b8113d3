"""Many photos: rows of a table on all cores.

Or on a cluster; their results, the report, and the review.
"""
