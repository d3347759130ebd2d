"""Compiler passes, one module each in `transforms`, and what they rest on; `pipeline` lists them in order."""
