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
from yasps.frontend.execution.newton_system import (
    SOLVERS,
    WHEN_TO_PROJECT,
    NewtonSolution,
    SolveOptions,
    advice_on,
    solve_newton_system,
    solve_options,
)
from yasps.frontend.language.attribute import (
    Attribute,
    as_attribute,
    concat_cols,
    concat_rows,
    constant,
    identity,
    zeros,
)
from yasps.frontend.language.connectivity import Connectivity
from yasps.frontend.language.functions import (
    atan2,
    eigenvalues,
    hypot,
    maximum,
    minimum,
    polar,
    select,
    singular_values,
    stumpff,
)
from yasps.frontend.language.mesh import Mesh
from yasps.frontend.language.nodes import ComputedValue, FloatArray
from yasps.frontend.language.primitive import Primitive, PrimitiveBase, PrimitiveUnion
from yasps.frontend.scene import Scene, Solution, add_scene, scene
from yasps.runtime.build.private_folder import CacheFolderError
from yasps.runtime.build.toolchain import CompilationError, CompilerNotFoundError
from yasps.runtime.device.driver import NoDeviceError
from yasps.runtime.device.protocol import DeviceError, DeviceMemoryError

# The paper's spelling.
addScene = add_scene  # noqa: N816
adviceOn = advice_on  # noqa: N816
asAttribute = as_attribute  # noqa: N816
concatCols = concat_cols  # noqa: N816
concatRows = concat_rows  # noqa: N816
singularValues = singular_values  # noqa: N816
solveNewtonSystem = solve_newton_system  # noqa: N816
solveOptions = solve_options  # noqa: N816

__version__ = "0.1.0"

__all__ = [
    "SOLVERS",
    "WHEN_TO_PROJECT",
    "Attribute",
    "CacheFolderError",
    "CompilationError",
    "CompilerNotFoundError",
    "ComputedValue",
    "Connectivity",
    "ConnectivityError",
    "DataError",
    "DeviceError",
    "DeviceMemoryError",
    "FloatArray",
    "IntersectionError",
    "LineageError",
    "Mesh",
    "NameTakenError",
    "NewtonSolution",
    "NoDeviceError",
    "NotConvergedError",
    "NotFiniteError",
    "Primitive",
    "PrimitiveBase",
    "PrimitiveUnion",
    "Scene",
    "SceneError",
    "ShapeMismatchError",
    "Solution",
    "SolveOptions",
    "UnsupportedSceneError",
    "YaspsError",
    "__version__",
    "addScene",
    "add_scene",
    "adviceOn",
    "advice_on",
    "asAttribute",
    "as_attribute",
    "atan2",
    "concatCols",
    "concatRows",
    "concat_cols",
    "concat_rows",
    "constant",
    "eigenvalues",
    "hypot",
    "identity",
    "maximum",
    "minimum",
    "polar",
    "scene",
    "select",
    "singularValues",
    "singular_values",
    "solveNewtonSystem",
    "solveOptions",
    "solve_newton_system",
    "solve_options",
    "stumpff",
    "zeros",
]
