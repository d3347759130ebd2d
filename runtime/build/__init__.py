"""Compilers, linkers and the cache of what they make."""
