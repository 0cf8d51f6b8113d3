"""Pictures for a person."""
