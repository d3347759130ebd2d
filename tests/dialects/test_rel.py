"""The `rel` dialect: every operation prints and parses back, and every law is checked with names in its message."""

from __future__ import annotations

import ast
from pathlib import Path
from traceback import walk_tb

import pytest
from xdsl.dialects.builtin import ModuleOp
from xdsl.ir import Operation
from xdsl.parser import Parser
from xdsl.utils.exceptions import ParseError, VerifyException

from yasps.dialects.rel import Rel, laws
from yasps.passes.pipeline import make_context

SCENE = """
builtin.module {
  rel.scene @scene {
    rel.mesh @m in @scene
    rel.mesh @n in @scene
    rel.primitive @m.v in @m size 4
    rel.primitive @n.v in @n size 3
    rel.primitive @m.p in @m dynamic
    rel.primitive_union @m.u in @m of [@m.v, @n.v]
    rel.connectivity @m.p.ends from @m.p to @m.u arity 2
    rel.storage @m.v.x on @m.v : 3x1
    rel.storage @n.v.x on @n.v : 3x1
    rel.storage @m.k on @m : 1x1 constant
    rel.storage @g on @scene : 1x1 constant
    rel.attribute @m.u.x on @m.u : 3x1 {
      %0 = rel.union [@m.v.x, @n.v.x] : 3x1
      rel.yield %0
    }
    rel.attribute @m.p.stiffness on @m.p : 1x1 {
      %1 = rel.data @m.k : 1x1
      %2 = rel.data @g : 1x1
      %3 = "mat.scale"(%1, %2) : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      rel.yield %3
    }
    rel.attribute @m.p.energy on @m.p : 1x1 output {
      %4 = rel.join @m.u.x through @m.p.ends : 2x3
      %5 = rel.ref @m.p.stiffness : 1x1
      %6 = mat.dot %4, %4 : 1x1
      %7 = mat.scale %5, %6 : 1x1
      rel.yield %7
    }
    rel.attribute @m.v.elsewhere on @m.v : 2x2
    rel.attribute @m.v.x.kappa on @m.v : 1x1xi32 {
      %8 = rel.target_index @m.v.x : 1x1xi32
      rel.yield %8
    }
    rel.attribute @n.v.x.kappa on @n.v : 1x2xi32
    rel.attribute @m.u.x.kappa on @m.u : 1x2xi32 {
      %9 = rel.union_indices [@m.v.x.kappa, @n.v.x.kappa] : 1x2xi32
      rel.yield %9
    }
    rel.attribute @m.p.kappa on @m.p : 2x2xi32 {
      %26 = rel.join_indices @m.u.x.kappa through @m.p.ends : 2x2xi32
      rel.yield %26
    }
    rel.energy @m.p.energy projection "clamp" dynamic
    rel.target @m.v.x
    rel.jacobian @m.v.x.jacobian of @m.v.x on @m.v indices @m.v.x.kappa {
      %10 = rel.data @m.v.x : 3x1
      %11 = mat.identity : 3x3
      rel.yield_jacobian %11 wrt %10
    }
    rel.jacobian @m.v.x.lowered of @m.v.x on @m.v {
    ^bb0(%24: tensor<3x1xf64>):
      %25 = rel.data @m.v.x : 3x1
      rel.yield_pullback %24 wrt %25
    }
    rel.curvature @m.v.x.curvature of @m.v.x on @m.v {
    ^bb0(%18: tensor<3x1xf64>):
      %19 = rel.data @m.v.x : 3x1
      %21 = mat.transpose %19 : 1x3
      %20 = mat.matmul %18, %21 : 3x3
      rel.yield_curvature %20 wrt %19
    }
    rel.derivative @m.p.affine of @m.p.energy on @m.p projection "none" curved {
      %12 = rel.join @m.u.x through @m.p.ends : 2x3
      %13 = mat.reshape %12 : 6x1
      %22 = mat.dot %13, %13 : 1x1
      rel.yield_derivative %22 gradient %13 wrt %12
    }
  }
  rel.object @energy.object entries ["batch", "call"] {
    rel.derivative @m.p.derivative of @m.p.energy on @m.p projection "clamp" dynamic indices @m.v.x.kappa \
projects "6x6" {
      %14 = rel.join @m.u.x through @m.p.ends : 2x3
      %23, %15, %16 = rel.apply @derive(%14) : 1x1, 6x1, 21x1
      %17 = rel.project %16 width 6 mode "clamp" : 21x1
      rel.yield_derivative %23 gradient %15 hessian %17 wrt %14
    }
  }
}
"""


def parse(text: str) -> ModuleOp:
    """The module, not verified."""
    return Parser(make_context(), text).parse_module()


def test_the_scene_of_these_tests_holds_every_operation() -> None:
    names = {op.name for op in parse(SCENE).walk()}
    assert {op.name for op in Rel.operations} <= names


def test_every_operation_parses_verifies_and_prints_back() -> None:
    module = parse(SCENE)
    module.verify()
    text = str(module)
    again = parse(text)
    again.verify()
    assert str(again) == text
    assert again.is_structurally_equivalent(module)


@pytest.mark.parametrize("op_class", list(Rel.operations), ids=lambda op: op.name)
def test_custom_syntax(op_class: type[Operation]) -> None:
    """No operation needs the generic form with quotes."""
    assert f"{op_class.name} " in str(parse(SCENE))
    assert f'"{op_class.name}"' not in str(parse(SCENE))


def test_optional_words_are_kept() -> None:
    text = str(parse(SCENE))
    for line in (
        "rel.primitive @m.p in @m dynamic",
        "rel.storage @m.k on @m : 1x1 constant",
        "rel.attribute @m.p.energy on @m.p : 1x1 output",
        'rel.energy @m.p.energy projection "clamp" dynamic',
        'rel.derivative @m.p.affine of @m.p.energy on @m.p projection "none" curved',
    ):
        assert line in text


BREAKS: dict[str, tuple[str, str, str]] = {
    # law: (what stands in the scene, what is put there, message)
    "a connectivity starts at a primitive": (
        "from @m.p to @m.u",
        "from @m to @m.u",
        "@m.p.ends needs a primitive, but @m is rel.mesh",
    ),
    "a connectivity leads to a primitive": (
        "from @m.p to @m.u",
        "from @m.p to @m.w",
        "@m.p.ends names a primitive @m.w, which does not exist",
    ),
    "an arity is positive": ("arity 2", "arity 0", "@m.p.ends has arity 0; the least is 1"),
    "a union is of primitives": (
        "of [@m.v, @n.v]",
        "of [@m.v, @n]",
        "@m.u needs a primitive, but @n is rel.mesh",
    ),
    "an energy exists": (
        "rel.energy @m.p.energy",
        "rel.energy @m.p.missing",
        "an energy names an attribute @m.p.missing, which does not exist",
    ),
    "an energy is 1x1": (
        "rel.energy @m.p.energy",
        "rel.energy @m.v.elsewhere",
        "an energy is 1x1, but @m.v.elsewhere is 2x2",
    ),
    "a projection is known": ('projection "clamp" dynamic\n', 'projection "maybe"\n', "clamp, abs, none, got 'maybe'"),
    "a target is stored": (
        "rel.target @m.v.x\n",
        "rel.target @m.u.x\n",
        "a target needs a stored variable as target, but @m.u.x is rel.attribute",
    ),
    "a target is a variable": ("rel.target @m.v.x\n", "rel.target @m.k\n", "@m.k is a constant; a target must be a"),
    "a storage holds matrices": (
        "rel.storage @g on @scene : 1x1",
        "rel.storage @g on @scene : f64",
        "g must be a matrix tensor<RxCxf64> of 1 to 1048576 entries, not f64",
    ),
    "data is read with its type": (
        "rel.storage @m.k on @m : 1x1",
        "rel.storage @m.k on @m : 2x1",
        "@m.p.stiffness uses @m.k as 1x1, but it is 2x1",
    ),
    "data exists": (
        "rel.data @m.k",
        "rel.data @m.j",
        "@m.p.stiffness names an attribute @m.j, which does not exist",
    ),
    "data is stored": (
        "rel.data @m.k",
        "rel.data @m.p.stiffness",
        "@m.p.stiffness needs a stored attribute for rel.data, but @m.p.stiffness is rel.attribute",
    ),
    "a reference is computed": (
        "rel.ref @m.p.stiffness",
        "rel.ref @m.k",
        "@m.p.energy needs a computed attribute for rel.ref, but @m.k is rel.storage",
    ),
    "data is of the lineage (other primitive)": (
        "rel.storage @m.k on @m ",
        "rel.storage @m.k on @m.v ",
        "@m.p.stiffness lives on @m.p and reads @m.k of @m.v: attributes of different lineages meet only through",
    ),
    "data is of the lineage (other mesh)": (
        "rel.storage @m.k on @m ",
        "rel.storage @m.k on @n ",
        "@m.p.stiffness lives on @m.p and reads @m.k of @n",
    ),
    "a reference is of the lineage": (
        "rel.attribute @m.p.stiffness on @m.p :",
        "rel.attribute @m.p.stiffness on @m.v :",
        "@m.p.energy lives on @m.p and reads @m.p.stiffness of @m.v",
    ),
    "a JOIN goes through a connectivity": (
        "through @m.p.ends : 2x3\n      %5",
        "through @m.p.stiffness : 2x3\n      %5",
        "@m.p.energy needs a connectivity, but @m.p.stiffness is rel.attribute",
    ),
    "a JOIN's connectivity starts at the owner": (
        "from @m.p to @m.u",
        "from @m.v to @m.u",
        "@m.p.energy lives on @m.p, but connectivity @m.p.ends starts at @m.v",
    ),
    "a JOIN's source lives where the connectivity leads": (
        "rel.join @m.u.x through @m.p.ends : 2x3\n      %5",
        "rel.join @m.v.x through @m.p.ends : 2x3\n      %5",
        "@m.p.energy joins @m.v.x of @m.v through @m.p.ends, which leads to @m.u",
    ),
    "a JOIN has a row for each slot": (
        "arity 2",
        "arity 3",
        "@m.p.energy: a JOIN of arity 3 of 3x1 values is 3x3, not 2x3",
    ),
    "a JOIN through a variable arity reduces": (
        "arity 2",
        "arity 2 variable",
        "@m.p.energy: a JOIN through @m.p.ends needs an operation, its arity varies",
    ),
    "a JOIN through a fixed arity does not": (
        "rel.join @m.u.x through @m.p.ends : 2x3\n      %5",
        'rel.join @m.u.x through @m.p.ends operation "sum" : 2x3\n      %5',
        "@m.p.energy: a JOIN through @m.p.ends takes no operation, its arity is fixed",
    ),
    "a JOIN's operation is known": (
        "rel.join @m.u.x through @m.p.ends : 2x3\n      %5",
        'rel.join @m.u.x through @m.p.ends operation "max" : 2x3\n      %5',
        "operation must be one of sum, mean, got 'max'",
    ),
    "a UNION lives on a primitive union": (
        "rel.attribute @m.u.x on @m.u :",
        "rel.attribute @m.u.x on @m.v :",
        "@m.u.x needs a primitive union, but @m.v is rel.primitive",
    ),
    "a UNION has all members": (
        "rel.union [@m.v.x, @n.v.x]",
        "rel.union [@m.v.x]",
        "@m.u.x unites 1 attributes, but @m.u has 2 members",
    ),
    "a UNION's members come in order": (
        "rel.union [@m.v.x, @n.v.x]",
        "rel.union [@n.v.x, @m.v.x]",
        "@m.u.x: @n.v.x lives on @n.v, expected @m.v",
    ),
    "a UNION's members have one shape": (
        "rel.storage @n.v.x on @n.v : 3x1",
        "rel.storage @n.v.x on @n.v : 2x1",
        "@m.u.x is 3x1, but @n.v.x is 2x1",
    ),
    "a UNION of placement indices is as long as the longest": (
        "rel.attribute @n.v.x.kappa on @n.v : 1x2xi32",
        "rel.attribute @n.v.x.kappa on @n.v : 1x3xi32",
        "@m.u.x.kappa is 1x2, but @n.v.x.kappa is 1x3",
    ),
    "a JOIN is of numbers": (
        "rel.join_indices @m.u.x.kappa",
        "rel.join @m.u.x.kappa",
        "rel.join gives numbers, not the other",
    ),
    "a UNION of placement indices says so": (
        "rel.union_indices [",
        "rel.union [",
        "rel.union gives numbers, not the other",
    ),
    "placement indices are no numbers": (
        "rel.union [@m.v.x, @n.v.x]",
        "rel.union_indices [@m.v.x, @n.v.x]",
        "rel.union_indices gives placement indices, not the other",
    ),
    "a placement index is of a stored variable": (
        "rel.target_index @m.v.x",
        "rel.target_index @m.v.elsewhere",
        "@m.v.x.kappa needs a stored variable, but @m.v.elsewhere is rel.attribute",
    ),
    "an attribute ends with its value": (
        "rel.yield %3",
        "rel.yield_jacobian %3 wrt %3",
        "@m.p.stiffness must end with rel.yield",
    ),
    "an attribute's value has its type": (
        "rel.attribute @m.p.stiffness on @m.p : 1x1",
        "rel.attribute @m.p.stiffness on @m.p : 2x2",
        "@m.p.stiffness uses @m.p.stiffness as 1x1, but it is 2x2",
    ),
    "an owner is an entity": (
        "rel.attribute @m.p.stiffness on @m.p :",
        "rel.attribute @m.p.stiffness on @m.k :",
        "@m.k is rel.storage, not a scene, mesh or primitive",
    ),
    "a gradient has an entry for each input": (
        "gradient %13 wrt %12",
        "gradient %12 wrt %12",
        "the gradient with respect to 6 entries is 6x1, got 2x3",
    ),
    "a Hessian is square or packed": (
        "hessian %17",
        "hessian %15",
        "the Hessian with respect to 6 entries is 6x6 (or its packed upper triangle), got 6x1",
    ),
    "a Jacobian has a column for each input": (
        "rel.yield_jacobian %11 wrt %10",
        "rel.yield_jacobian %10 wrt %11",
        "a Jacobian with respect to 9 entries has 9 columns, got 3x1",
    ),
    "a Jacobian is no pull-back": (
        "rel.yield_jacobian %11 wrt %10",
        "rel.yield_jacobian %10 wrt %10",
        "a Jacobian with respect to 3 entries has 3 columns, got 3x1",
    ),
    "a pull-back is no Jacobian": (
        "rel.yield_jacobian %11 wrt %10",
        "rel.yield_pullback %11 wrt %10",
        "the cotangent of 3 entries is 3x1, got 3x3",
    ),
    "a curvature is square or packed": (
        "rel.yield_curvature %20 wrt %19",
        "rel.yield_curvature %19 wrt %20",
        "a Hessian with respect to 9 entries is 9x9 (or its packed upper triangle), got 3x1",
    ),
    "a curvature's body is of the lineage": (
        "rel.curvature @m.v.x.curvature of @m.v.x on @m.v ",
        "rel.curvature @m.v.x.curvature of @m.v.x on @n.v ",
        "@m.v.x.curvature lives on @n.v and reads @m.v.x of @m.v",
    ),
    "a packed triangle has the size of its width": (
        "width 6",
        "width 5",
        "the upper triangle of a 5x5 matrix has 15 entries",
    ),
    "a projection mode is known": ('mode "clamp"', 'mode "none"', "mode must be one of clamp, abs, got 'none'"),
    "names are unique": (
        "rel.mesh @n in @scene",
        "rel.mesh @m in @scene",
        'Redefinition of symbol "m"',
    ),
}


def test_every_law_is_broken() -> None:
    """With its message; and each `raise` of laws.py is reached: a new law needs an entry in `BREAKS`."""
    source = Path(laws.__file__)
    raises = [node for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))) if isinstance(node, ast.Raise)]
    reached: set[int] = set()
    for law, (old, new, message) in BREAKS.items():
        assert old in SCENE, law
        broken = parse(SCENE.replace(old, new))
        with pytest.raises(VerifyException) as error:
            broken.verify()
        assert message in str(error.value), law
        raised: BaseException | None = error.value
        while raised is not None:
            frames = walk_tb(raised.__traceback__)
            reached |= {line for frame, line in frames if Path(frame.f_code.co_filename).samefile(source)}
            raised = raised.__cause__
    missed = [node.lineno for node in raises if not any(node.lineno <= n <= (node.end_lineno or 0) for n in reached)]
    assert not missed, f"no test breaks the laws in these lines of {source}: {missed}"


def test_objects_see_what_the_scene_declares() -> None:
    module = parse(SCENE.replace("rel.connectivity @m.p.ends", "rel.connectivity @m.p.pairs"))
    with pytest.raises(VerifyException, match=r"names a connectivity @m\.p\.ends, which does not exist"):
        module.verify()


@pytest.mark.parametrize(
    "text", ["rel.mesh @m", "rel.energy @e", "rel.storage @s on @m", "rel.connectivity @c from @a to @b"]
)
def test_incomplete_declarations_do_not_parse(text: str) -> None:
    with pytest.raises(ParseError):
        parse(text)
