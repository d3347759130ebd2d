"""Local derivatives to global ones, on a device."""
