"""Local derivatives to global ones."""
