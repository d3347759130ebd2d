"""Scalar IR to C++ text, and the programs made of it; the NumPy interpreter."""
