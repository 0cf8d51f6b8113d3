"""pyrender as the second renderer, and the maker of synthetic photos."""
