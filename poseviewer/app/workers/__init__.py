"""What runs beside the main loop, in threads."""
