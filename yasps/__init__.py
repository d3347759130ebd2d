"""yasps: a compiler for physical simulation.

Describe a scene - primitives, connectivities, attributes, energies - and the compiler derives gradients, positive
semi-definite Hessians, the sparsity of the global system and fast kernels, and solves the Newton system.
"""

from yasps.frontend.errors import (
    ConnectivityError,
    DataError,
    IntersectionError,
    LineageError,
    NameTakenError,
    NotConvergedError,
    NotFiniteError,
    SceneError,
    ShapeMismatchError,
    UnsupportedSceneError,
    YaspsError,
)
from yasps.frontend.language.attribute import (
    Attribute,
    ComputedValue,
    concat_cols,
    concat_rows,
    constant,
    identity,
    zeros,
)
from yasps.frontend.language.connectivity import Connectivity
from yasps.frontend.language.functions import atan2, maximum, minimum, select, stumpff
from yasps.frontend.language.mesh import Mesh
from yasps.frontend.language.primitive import Primitive, PrimitiveUnion
from yasps.frontend.scene import Scene, Solution, add_scene, scene

addScene = add_scene  # noqa: N816 - the paper's spelling
concatRows = concat_rows  # noqa: N816
concatCols = concat_cols  # noqa: N816

__version__ = "0.1.0"

__all__ = [
    "Attribute",
    "ComputedValue",
    "Connectivity",
    "ConnectivityError",
    "DataError",
    "IntersectionError",
    "LineageError",
    "Mesh",
    "NameTakenError",
    "NotConvergedError",
    "NotFiniteError",
    "Primitive",
    "PrimitiveUnion",
    "Scene",
    "SceneError",
    "ShapeMismatchError",
    "Solution",
    "UnsupportedSceneError",
    "YaspsError",
    "__version__",
    "addScene",
    "add_scene",
    "atan2",
    "concatCols",
    "concatRows",
    "concat_cols",
    "concat_rows",
    "constant",
    "identity",
    "maximum",
    "minimum",
    "scene",
    "select",
    "stumpff",
    "zeros",
]
