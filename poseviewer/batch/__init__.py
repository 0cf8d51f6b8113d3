"""Many photos: rows of a table, fitted on all cores or on a cluster, and what came of them."""
