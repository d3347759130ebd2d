"""Springs between all pairs of vertices of a union, whose members are parameterised in different ways."""

from __future__ import annotations

from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from yasps import Attribute, Primitive, PrimitiveBase, Scene

COUNT = 3
"""Vertices of each member."""


class UnionScene:
    """The scene, its union of vertices, and the targets behind them."""

    def __init__(
        self,
        members: tuple[str, ...],
        *,
        projection: str = "none",
        nested: bool = False,
        most: int | None = None,
        **options: Any,
    ) -> None:
        """members: "free" (targets), "pinned" (constants), "moved" (stored, but no target), "affine", "empty" (no
        vertices), "computed" (of constants) or "of a union" (means of free and pinned ones); any several times.
        nested: the first two are a union of their own. most: springs are between so many of the vertices. options: of
        the scene."""
        self.random = np.random.default_rng(5)
        self.scene = Scene("union", **options)
        self.targets: list[Attribute] = []
        made: list[PrimitiveBase] = [self._member(kind, f"{kind[:2]}{k}") for k, kind in enumerate(members)]
        if nested:
            made = [self._union("inner", made[:2]), *made[2:]]
        self.vertices = self._union("outer", made)
        self._add_energies(projection, most or self.vertices.num_instances)
        self.scene.add_minimize_target(self.targets)

    def _union(self, name: str, members: list[PrimitiveBase]) -> PrimitiveBase:
        union = self.scene.add_mesh(name).add_primitive_union("v", members)
        union.add_attribute("x")
        return union

    def _numbers(self, *shape: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        return self.random.uniform(-1, 1, shape)

    def _member(self, kind: str, name: str) -> Primitive:
        mesh = self.scene.add_mesh(name)
        if kind == "empty":
            vertices = mesh.add_primitive("v", 0, is_dynamic=True)
            self.targets.append(vertices.add_attribute("x", 3, 1))
            return vertices
        if kind == "of a union":
            free, pinned = self._member("free", f"{name}f"), self._member("pinned", f"{name}p")
            return self._means_over(mesh.add_primitive("v", COUNT), self._union(f"{name}u", [free, pinned]))
        vertices = mesh.add_primitive("v", COUNT)
        numbers = self._numbers(COUNT, 3)
        if kind == "free":
            self.targets.append(vertices.add_attribute("x", 3, 1, value=numbers))
        elif kind == "moved":
            vertices.add_attribute("x", 3, 1, value=numbers)
        elif kind == "pinned":
            vertices.add_constant("x", 3, 1, value=numbers)
        elif kind == "computed":
            rest = vertices.add_constant("rest", 3, 1, value=numbers)
            vertices.add_attribute("x", computed_attribute=2 * rest)
        else:
            body = mesh.add_primitive("bodies", 2)
            matrix = body.add_attribute("A", 3, 3, value=self._numbers(2, 3, 3))
            shift = body.add_attribute("t", 3, 1, value=self._numbers(2, 3))
            of_body = vertices.add_connectivity("of_body", body, [0, 1, 0], 1)
            a = vertices.add_attribute("A", through=of_body, source=matrix).reshape(3, 3)
            t = vertices.add_attribute("t", through=of_body, source=shift).reshape(3, 1)
            vertices.add_attribute("x", computed_attribute=a * vertices.add_constant("r", 3, 1, value=numbers) + t)
            self.targets += [matrix, shift]
        return vertices

    def _means_over(self, vertices: Primitive, union: PrimitiveBase) -> Primitive:
        ends = vertices.add_connectivity("ends", union, [[0, 1], [1, COUNT], [COUNT, COUNT + 1]], 2)
        pair = vertices.add_attribute("pair", through=ends, source=union["x"])
        vertices.add_attribute("x", computed_attribute=(0.25 * pair.row(0) + 0.75 * pair.row(1)).T)
        return vertices

    def _add_energies(self, projection: str, most: int) -> None:
        """Springs between any two vertices, each with itself too, dynamic ones in another order, and a weight of
        each vertex."""
        pairs = np.array(list(combinations_with_replacement(range(most), 2)))
        mesh = self.scene.add_mesh("springs")
        turned = np.random.default_rng(6).permutation(pairs)[:, ::-1]
        for name, ends, dynamic in (("static", pairs, False), ("dynamic", turned, True)):
            springs = mesh.add_primitive(name, 0 if dynamic else len(ends), is_dynamic=dynamic)
            connectivity = springs.add_connectivity("ends", self.vertices, [] if dynamic else ends, 2)
            x = springs.add_attribute("x", through=connectivity, source=self.vertices["x"])
            between = x.row(1) - 0.5 * x.row(0)
            excess = between.dot(between) - 0.7
            energy = springs.add_attribute("energy", computed_attribute=excess * excess)
            self.scene.add_energy(energy, projection=projection)
            if dynamic:
                connectivity.update_value(ends)
        own = self.vertices["x"]
        weight = self.vertices.add_attribute("weight", computed_attribute=own.dot(own) * own[2])
        self.scene.add_energy(weight, projection=projection)
