"""Errors about what a user wrote. Each message says what was given, which rule it breaks and what to do."""


class YaspsError(Exception):
    """Base of every error yasps raises about what a user wrote."""


class NameTakenError(YaspsError, ValueError):
    """A name is used already, or can't be a name."""


class LineageError(YaspsError, ValueError):
    """Attributes of different primitives met outside a JOIN or UNION (paper, 4.3)."""


class ShapeMismatchError(YaspsError, ValueError):
    """Rows and columns that don't fit together."""


class DataError(YaspsError, ValueError):
    """Numbers of the wrong count or kind, or NaN or infinity among them."""


class ConnectivityError(YaspsError, ValueError):
    """Indices of the wrong count, kind or range."""


class SceneError(YaspsError, ValueError):
    """Something is missing in the scene, or doesn't belong where it was put."""


class IntersectionError(YaspsError, ValueError):
    """Surfaces cross or touch, or do so on their way, where they must be apart."""


class NotFiniteError(YaspsError, ArithmeticError):
    """An energy or its derivatives are not finite at the current values."""


class NotConvergedError(YaspsError, ArithmeticError):
    """A solver stopped before it reached its tolerance."""


class UnsupportedSceneError(YaspsError):
    """The scene is well-formed, but this version can't compile it."""
