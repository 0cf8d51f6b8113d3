"""Search, verdict and maps of the loss, without disk, threads or windows."""
