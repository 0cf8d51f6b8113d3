"""Numbers only: the loss, the search, the landscape. No disk, no thread, no window."""
