"""IR to C++ for packs of instances."""
