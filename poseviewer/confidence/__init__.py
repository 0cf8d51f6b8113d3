"""Whether a pose is right: found, doubtful or lost, and why."""
