"""Errors of the compiler about what a scene says."""


class CompileError(Exception):
    """The scene is well-formed, but this version can't compile it; the message says what to do."""
