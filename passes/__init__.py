"""Compiler passes, one module each; `pipeline` lists them in order."""
