"""What a person sees: panels, the scene over the photo, maps."""
