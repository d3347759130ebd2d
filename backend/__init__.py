"""Scalar IR to C++ and CUDA text, and the programs made of it; the NumPy interpreter."""
