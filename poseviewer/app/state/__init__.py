"""Session of the user, and functions that change it, without disk, threads or GUI."""
