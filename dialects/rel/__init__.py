"""The `rel` dialect: a scene as a relational program (architecture, section 3; paper, section 4).

`declarations` holds what stands in a scene, `body` what stands in the body of an attribute and
`terminators` what ends one, `laws` what must hold.
"""

from xdsl.ir import Dialect

from yasps.dialects.rel import body, declarations, terminators
from yasps.dialects.rel.body import (
    ApplyOp,
    DataOp,
    JoinIndicesOp,
    JoinNumbersOp,
    JoinOp,
    ProjectOp,
    ReadOp,
    RefOp,
    TargetIndexOp,
    UnionIndicesOp,
    UnionNumbersOp,
    UnionOp,
)
from yasps.dialects.rel.declarations import (
    PROJECTIONS,
    AttributeOp,
    ConnectivityOp,
    Container,
    CurvatureOp,
    DerivativeOp,
    EnergyOp,
    JacobianOp,
    MeshOp,
    ObjectOp,
    PrimitiveOp,
    PrimitiveUnionOp,
    SceneOp,
    StorageOp,
    TargetOp,
    name_of,
    symbol,
)
from yasps.dialects.rel.laws import Scope
from yasps.dialects.rel.terminators import (
    YieldCurvatureOp,
    YieldDerivativeOp,
    YieldJacobianOp,
    YieldOp,
    YieldPullbackOp,
    packed_size,
)

Rel = Dialect("rel", [*declarations.OPS, *body.OPS, *terminators.OPS], [])

__all__ = [
    "PROJECTIONS",
    "ApplyOp",
    "AttributeOp",
    "ConnectivityOp",
    "Container",
    "CurvatureOp",
    "DataOp",
    "DerivativeOp",
    "EnergyOp",
    "JacobianOp",
    "JoinIndicesOp",
    "JoinNumbersOp",
    "JoinOp",
    "MeshOp",
    "ObjectOp",
    "PrimitiveOp",
    "PrimitiveUnionOp",
    "ProjectOp",
    "ReadOp",
    "RefOp",
    "Rel",
    "SceneOp",
    "Scope",
    "StorageOp",
    "TargetIndexOp",
    "TargetOp",
    "UnionIndicesOp",
    "UnionNumbersOp",
    "UnionOp",
    "YieldCurvatureOp",
    "YieldDerivativeOp",
    "YieldJacobianOp",
    "YieldOp",
    "YieldPullbackOp",
    "name_of",
    "packed_size",
    "symbol",
]
