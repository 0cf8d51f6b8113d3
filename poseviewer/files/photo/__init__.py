"""Photos and masks."""
