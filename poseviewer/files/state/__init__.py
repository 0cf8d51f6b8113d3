"""Session and uploads that the app keeps between runs."""
