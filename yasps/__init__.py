"""yasps: a compiler for physical simulation."""
