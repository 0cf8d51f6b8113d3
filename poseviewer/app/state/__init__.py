"""What the user has open, and how a command changes it: no disk, no thread, no GUI."""
