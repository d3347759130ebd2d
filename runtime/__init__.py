"""The solver runtime in C++, the tool chain that builds it and its Python loader."""
