"""From mesh and pose to attributes and moments, by three renderers; the overlay; the pyramid."""
