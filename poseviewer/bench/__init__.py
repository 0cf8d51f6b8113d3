"""Speed: evaluations, fits, maps, on each path."""
