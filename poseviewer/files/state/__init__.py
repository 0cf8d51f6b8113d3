"""Session that the app keeps between runs."""
