"""The interpreter itself, against sums written out by hand: what everything else is measured with."""

from __future__ import annotations

import numpy as np
import pytest
from mat_bodies import relative_error
from small_scenes import emit, mixed_union
from xdsl.dialects import arith, func, math
from xdsl.dialects.builtin import FloatAttr, f64
from xdsl.ir import Block, Region

from yasps import Scene
from yasps.backend.codegen import scalar_function as cpp_function
from yasps.backend.codegen.scalar_function import CALLS, CHOICES, INFIX, function_text
from yasps.backend.reference.interpreter import COMPARISONS, SCALAR_OPERATIONS, Interpreter, run_function
from yasps.passes.transforms import lower_to_scalar
from yasps.passes.transforms.lower_to_scalar import BINARY, UNARY


def test_joins_unions_and_ancestors_by_hand() -> None:
    scene = mixed_union()
    emitted = emit(scene)
    interpreter = Interpreter(emitted.module, emitted.data)
    data = emitted.data.storages
    a, t, rest = data["stiff.body.A"][0], data["stiff.body.t"][0], data["stiff.v.rest"]
    points = np.concatenate([a @ rest + t, data["soft.v.x"]])
    assert relative_error(interpreter.value("both.v.x"), points) < 1e-15
    gravity = 9.8 * points[:, 2, 0] + (points**2).sum(axis=(1, 2))
    assert relative_error(interpreter.value("both.v.gravity").ravel(), gravity) < 1e-14
    ends = emitted.data.connectivities["both.pp.ends"]
    d = ((points[ends[:, 0]] - points[ends[:, 1]]) ** 2).sum(axis=(1, 2))
    barrier = 10.0 * (d - 2.5) ** 2 * np.log(d / 2.5) ** 2
    assert relative_error(interpreter.value("both.pp.barrier").ravel(), barrier) < 1e-14


def test_assembly_by_hand() -> None:
    """e = (k / 2) |x_i - x_j|^2 on a chain: the graph Laplacian."""
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    points, springs = mesh.add_primitive("v", 4), mesh.add_primitive("s", 3)
    x = points.add_attribute("x", 2, 1, value=np.random.default_rng(0).random((4, 2)))
    pairs = [[0, 1], [1, 2], [2, 3]]
    ends = springs.add_connectivity("ends", points, pairs, 2)
    pair = springs.add_attribute("pair", through=ends, source=x)
    between = pair.row(0) - pair.row(1)
    scene.add_energy(springs.add_attribute("e", computed_attribute=1.5 * between.dot(between)))
    scene.add_minimize_target(x)
    compiled = scene.compile()
    gradient, hessian = Interpreter(compiled.module, compiled.data()).assemble()
    incidence = np.zeros((3, 4))
    for row, (i, j) in enumerate(pairs):
        incidence[row, [i, j]] = 1, -1
    laplacian = np.kron(3.0 * incidence.T @ incidence, np.eye(2))
    assert relative_error(hessian.toarray(), laplacian) < 1e-15
    assert relative_error(gradient, laplacian @ x.value) < 1e-14


def test_every_scalar_operation_has_a_meaning_and_a_text() -> None:
    """What `lower-to-scalar` may write, the interpreter and the C++ emitter know."""
    written = {*BINARY.values(), *UNARY.values(), math.PowFOp, arith.SelectOp}
    assert set(SCALAR_OPERATIONS) == written
    assert {*INFIX, *CALLS, *CHOICES, arith.NegfOp} == written
    assert set(COMPARISONS) == set(cpp_function.COMPARISONS) == set(lower_to_scalar.COMPARISONS.values())


def test_a_scalar_function_as_text() -> None:
    block = Block(arg_types=[f64, f64])
    x, y = block.args
    half = arith.ConstantOp(FloatAttr(0.5, f64))
    product = arith.MulfOp(x, y)
    power = math.PowFOp(product.result, half.result)
    block.add_ops([half, product, power, func.ReturnOp(power.result, x)])
    function = func.FuncOp("f", ([f64, f64], [f64, f64]), Region(block))
    assert function_text(function, "f_one", "double", [1, 1], [2]) == (
        "static inline void f_one(const double* x0, const double* x1, double* __restrict y0) {\n"
        "    const double t3 = x0[0] * x1[0];\n"
        "    const double t4 = __builtin_pow(t3, 0.5);\n"
        "    y0[0] = t4;\n"
        "    y0[1] = x0[0];\n"
        "}\n"
    )
    packs = function_text(function, "f_pack", "V", [2], [1, 1])
    assert "const V t4 = v_pow(t3, splat(0.5));" in packs
    assert "    y0[0] = t4;\n    y1[0] = x0[0];\n" in packs
    first, second = run_function(function, [np.array([4.0, 9.0]), np.array([1.0, 4.0])])
    assert first.tolist() == [2.0, 6.0]
    assert second.tolist() == [4.0, 9.0]


def test_an_operation_without_a_text_is_named() -> None:
    block = Block(arg_types=[f64])
    rounded = math.FloorOp(block.args[0])
    block.add_ops([rounded, func.ReturnOp(rounded.result)])
    function = func.FuncOp("f", ([f64], [f64]), Region(block))
    with pytest.raises(ValueError, match=r"the C\+\+ emitter does not know math\.floor"):
        function_text(function, "f", "double", [1], [1])
