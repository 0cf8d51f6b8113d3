"""The scene: one type for the app's document, the library, scene files, sessions and batch rows."""
