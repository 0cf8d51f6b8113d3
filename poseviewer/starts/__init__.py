"""Start poses: from views, point pairs, wheels."""
