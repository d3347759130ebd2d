"""IR to CUDA, an instance a thread."""
