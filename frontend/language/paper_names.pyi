# ruff: noqa: N802
"""The paper's spelling for type checkers. Written by tools/write_stubs.py from the classes themselves."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from yasps.frontend.execution.compiled_scene import CompiledScene, CompileReport
from yasps.frontend.language.attribute import Attribute
from yasps.frontend.language.connectivity import Connectivity, IntArray
from yasps.frontend.language.entity import Entity
from yasps.frontend.language.mesh import Mesh
from yasps.frontend.language.nodes import FloatArray
from yasps.frontend.language.primitive import Primitive, PrimitiveBase, PrimitiveUnion
from yasps.runtime.device.foreign_arrays import DeviceIndices

class AttributeNames:
    @property
    def isVector(self) -> bool:
        """Whether it has one row or one column."""

    def updateValue(self, values: ArrayLike) -> None:
        """Sets the numbers of a stored attribute: [instances, rows, columns], [instances, rows * columns] or flat,
        row-major; for one instance its matrix alone, too. Axes of length 1 may be left out.

        On a dynamic primitive the number of instances follows from the data; its other parts must follow before the
        next result (`Primitive.update` sets all at once).

        Raises DataError for a wrong count or layout, for what are no real numbers, for masked entries, NaN and
        infinity; nothing is changed then.
        Raises SceneError for a computed attribute.
        """

    def stopGradient(self) -> Attribute:
        """The same value, held constant by differentiation."""

    def withDerivatives(
        self,
        arguments: Attribute | Sequence[Attribute],
        gradient: Attribute | Sequence[Attribute],
        *,
        hessian: Attribute | None = None,
        eigensystem: tuple[Attribute, Attribute] | None = None,
        check: bool = True,
    ) -> Attribute:
        """The same value with derivatives of one's own, which the compiler uses instead of deriving them.

        arguments: attributes that the formula is written with, m entries together. gradient: one attribute in the shape
        of each argument; if this attribute is not 1x1, its Jacobian instead, a row for each of its entries and a column
        for each of the arguments', all row-major. hessian: of a 1x1 attribute, m x m; without it the gradient is
        differentiated. eigensystem: of that Hessian instead, eigenvalues k x 1 and orthonormal eigenvectors m x k, one
        a column, k <= m; where this attribute is an energy and its arguments are affine in the targets, their negative
        ones are removed without looking for them. check: compare with what is derived, at random numbers, now.

        Derivatives with respect to what is reached otherwise than through the arguments raise SceneError when the scene
        is compiled. Raises SceneError where a given derivative is wrong, ShapeMismatchError, LineageError.
        """

class ConnectivityNames:
    @property
    def storedIndices(self) -> IntArray | DeviceIndices:
        """The same, where they are, and the same object until they are replaced."""

    def updateValue(self, indices: ArrayLike, counts: ArrayLike | None = None) -> None:
        """Replaces the indices (of a variable arity, with the counts); on a dynamic primitive the number of instances
        follows.

        In a scene on a GPU, indices of a fixed arity may be an int32 array there (`__cuda_array_interface__` or DLPack:
        CuPy, PyTorch, JAX, Warp). It is not copied, so leave it as it is and give a new one for new indices; its range
        is checked on the device, before the next result.

        Raises ConnectivityError for a wrong count, type or range; nothing is changed then.
        """

    def checkedParts(self, value: Any) -> IntArray | DeviceIndices:
        """Rows of indices from what a user gives: indices, or (indices, counts) of a variable arity."""

    def checkConsistent(self) -> None:
        """Raises ConnectivityError if source or target have changed their number of instances and the indices have not.

        Indices are checked when they are given; a dynamic target may shrink afterwards.
        """

class EntityNames:
    @property
    def numInstances(self) -> int:
        """How many instances it has; meshes and scenes have one."""

    @property
    def isDynamic(self) -> bool:
        """May the number of instances change?"""

    @property
    def followsData(self) -> bool:
        """Does the number of instances follow from the data given? On dynamic primitives it does."""

    def setNumInstances(self, count: int) -> None:
        """Notes the new number of instances of a dynamic primitive; raises SceneError for a change of anything else."""

    def checkName(self, name: object, what: str) -> str:
        """The name, if it can be one and is free here."""

    def checkChildName(self, name: object, what: str) -> str:
        """As check_name; a child is also reached as a Python attribute, so its name must not hide one of ours."""

    def addConstant(self, name: str, rows: int, cols: int, value: ArrayLike | None = None) -> Attribute:
        """Numbers that never take part in differentiation; zero until `update_value` (or `value`) sets them.

        Their values may still change over time (paper, 4.2). Raises NameTakenError, ShapeMismatchError, DataError.
        """

    def addAttribute(
        self,
        name: str,
        rows: int | None = None,
        cols: int | None = None,
        *,
        value: ArrayLike | None = None,
        computedAttribute: Attribute | None = None,
        through: Connectivity | None = None,
        source: Attribute | None = None,
        operation: str | None = None,
    ) -> Attribute:
        """Adds an attribute under a name (paper, 4.2, 4.5, 4.6). Exactly one of:

        - `rows`, `cols`: numbers the user sets, rows x cols on each instance; may be a minimisation target;
        - `computed_attribute`: a name for an expression of this entity's lineage;
        - `through`, `source`: JOIN of `source` (an attribute of the connectivity's target) through the connectivity;
          the result is arity x (rows cols). Through a connectivity of variable arity, with `operation` "sum" or "mean":
          the sum or mean over the connected instances, of the source's shape;
        - on a primitive union, the name alone: UNION of the members' attributes of that name.

        Raises NameTakenError, ShapeMismatchError, LineageError, ConnectivityError, DataError, SceneError.
        """

class PrimitiveBaseNames:
    def addConnectivity(
        self,
        name: str,
        target: PrimitiveBase,
        indices: ArrayLike,
        arity: int | None = None,
        *,
        counts: ArrayLike | None = None,
        longest: int = 1,
    ) -> Connectivity:
        """Connects each instance to `arity` instances of `target` (0-based; paper, 4.4).

        indices: instances x arity of them, flat or in rows; empty for a dynamic primitive until it is known.
        counts: instead of arity, how many of the (flat) indices each instance has; JOINs through such a connectivity of
        variable arity are sums or means (`operation`). longest: how many they may get later without a compile.
        Raises ConnectivityError for a wrong count, type, arity or range; NameTakenError.
        """

    def checkConsistent(self) -> None:
        """Raises DataError or ConnectivityError if numbers or indices don't match the current numbers of instances."""

class PrimitiveNames: ...

class PrimitiveUnionNames:
    def offsetOf(self, member: PrimitiveBase) -> int:
        """Where the member's instances start."""

class MeshNames:
    def addPrimitive(self, name: str, numInstances: int, isDynamic: bool = False) -> Primitive:
        """Adds a primitive type with this many instances; reached as `mesh.name` afterwards.

        Raises NameTakenError for a bad name, SceneError for a bad number of instances.
        """

    def addPrimitiveUnion(self, name: str, members: Sequence[PrimitiveBase]) -> PrimitiveUnion:
        """Adds the union of primitives, of unions too, of any meshes of the scene (paper, 4.6).

        Raises NameTakenError, SceneError.
        """

class SceneNames:
    @property
    def minimizeTargets(self) -> tuple[Attribute, ...]:
        """Minimisation targets, in order."""

    def setNumbers(self, values: Mapping[str, ArrayLike]) -> None:
        """Sets numbers and indices by their paths, all or none; what is the same already is left alone.

        Raises SceneError for a path that is not there, DataError, ConnectivityError.
        """

    def addMesh(self, name: str) -> Mesh:
        """Adds a mesh; reached as `scene.name` afterwards. Raises NameTakenError."""

    def addEnergy(self, attribute: Attribute, dynamicInstances: bool | None = None, projection: str = "clamp") -> None:
        """Registers a 1x1 attribute as a term of the energy: the sum over its instances is minimised (paper, 4.7).

        dynamic_instances: may the instances change from solve to solve? Default: as the primitive says.
        projection: what is done to negative eigenvalues of the local Hessians: "clamp" to 0, "abs"olute value, "none".

        Raises ShapeMismatchError if it isn't 1x1; SceneError for another scene's attribute, one registered before, one
        without an owner, a static energy on a dynamic primitive.
        """

    def addMinimizeTarget(self, targets: Attribute | Sequence[Attribute]) -> None:
        """Adds stored variables that energies are minimised over (paper, 4.7); results come in this order.

        Raises SceneError for computed attributes, constants, other scenes' attributes and repeated ones; nothing is
        added then.
        """

    def removeEnergy(self, attribute: Attribute) -> None:
        """Takes back what `add_energy` registered; the attribute stays. Raises SceneError if it is no energy."""

    def removeMinimizeTarget(self, targets: Attribute | Sequence[Attribute]) -> None:
        """Takes back what `add_minimize_target` added: the numbers stay as they are from now on.

        Raises SceneError if one is no target; nothing is removed then.
        """

    def minimizeEnergy(
        self,
        tolerance: float = 0.0001,
        maxIterations: int = 10000,
        *,
        solver: str = "pcg",
        projection: str = "always",
        preconditioner: str = "auto",
        fixed: Mapping[Attribute, ArrayLike] | None = None,
    ) -> list[FloatArray]:
        """x of H x = g, one flat array for each target (paper, 4.8); the Newton step is the *negative*: -x.

        g is the gradient of all energies, H their projected Hessian. tolerance: relative, on the squared norm of the
        residual, r^T D^-1 r <= tolerance g^T D^-1 g with H's diagonal blocks D. The rest: see `solve`.

        Raises NotConvergedError if the solver stops before that, NotFiniteError, SceneError without energies or
        targets, DataError or ConnectivityError for numbers that don't fit a dynamic primitive's size or bad arguments.
        """

    def mixedHessian(
        self, targets: Attribute | Sequence[Attribute], parameters: Attribute | Sequence[Attribute]
    ) -> sparse.csr_array[np.float64]:
        """Second derivatives d^2 E / (d targets d parameters), exact: one row for each scalar of the targets, one
        column for each of the parameters, in the order given.

        targets and parameters: stored attributes, of add_attribute or add_constant. This is the ground of inverse
        problems: at a minimum x(p) of E, H dx/dp = -mixed_hessian(x, p).

        Raises SceneError for computed, foreign or repeated attributes, or without energies.
        """

    def compileFor(
        self,
        inputs: Attribute | Sequence[Attribute],
        *,
        energies: Sequence[Attribute] | None = None,
        projected: bool = False,
    ) -> CompiledScene:
        """The sum of some energies compiled for derivatives with respect to these stored attributes, of add_attribute
        or add_constant, whichever the minimisation targets are; kept with the scene.

        energies: 1x1 attributes, registered or not; default all that are registered. projected: negative eigenvalues
        of the local Hessians are removed as the energies were registered, of others by "clamp"; else they are exact.

        Raises SceneError for computed, foreign or repeated inputs, foreign or repeated energies, or without any;
        ShapeMismatchError for an energy that isn't 1x1.
        """

    def totalEnergy(self) -> float:
        """Sum of all energies over all their instances; infinite or NaN where one is."""

    def energyValues(self) -> dict[str, FloatArray]:
        """Each energy on every instance, by its path."""

    @property
    def compileReport(self) -> CompileReport:
        """What compiling the scene took; compiles if needed."""

    @property
    def isOnDevice(self) -> bool:
        """Does the scene run on a GPU?"""

    def dumpIr(self, folder: str | Path, *, locations: bool = False) -> None:
        """Compiles the scene once more and writes into the folder the IR after every pass, the generated sources, and
        the scene's numbers as `data.npz`, on which `yasps-opt --interpret` runs any of the dumps.

        locations: print behind each attribute the line of Python that made it.

        Raises what `compile` does, DataError or ConnectivityError for numbers that don't fit, and SceneError for what
        can't be a folder.
        """

    def structureChanged(self) -> None:
        """The next result needs a new compile of the energies."""

    def arraysMoved(self, owner: Entity) -> None:
        """Some array of the owner was replaced by another."""

    def connectivityChanged(self, *connectivities: Connectivity) -> None:
        """Indices changed: derivatives go elsewhere."""

    def sizeChanged(self, primitive: PrimitiveBase) -> None:
        """A primitive or union has another number of instances."""
