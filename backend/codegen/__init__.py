"""What C++ and CUDA text have in common."""
