"""Start poses from a rectangle, point pairs, wheels or learned features."""
