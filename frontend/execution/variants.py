"""Energies of a scene compiled for chosen inputs, whichever its minimisation targets are, and derivatives by them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from yasps.frontend.execution.compiled_scene import CompiledScene
from yasps.frontend.execution.emit import EnergyTerm
from yasps.frontend.language.attribute import Attribute
from yasps.frontend.language.nodes import Stored

if TYPE_CHECKING:
    from scipy import sparse


class Variants:
    """What of a scene was compiled for other inputs than its targets; kept until its energies or targets change."""

    def __init__(self, compile_for: Callable[[Sequence[EnergyTerm], Sequence[Attribute]], CompiledScene]) -> None:
        """compile_for: compiles energies for derivatives by stored attributes."""
        self._compile_for = compile_for
        self._compiled: dict[tuple[tuple[Attribute, ...], tuple[EnergyTerm, ...]], CompiledScene] = {}
        self._weights: dict[Attribute, tuple[Attribute, Attribute]] = {}
        """Of `jacobian`: weights of an attribute, and its product with them."""

    def forget(self) -> None:
        """The next result needs a new compile."""
        self._compiled.clear()
        self._weights.clear()

    def of(self, energies: Sequence[EnergyTerm], inputs: Sequence[Attribute], *, exact: bool) -> CompiledScene:
        """The energies compiled for these inputs; `exact`: without projection."""
        chosen = [replace(term, projection="none") for term in energies] if exact else list(energies)
        key = (tuple(inputs), tuple(chosen))
        if key not in self._compiled or self._compiled[key].is_outgrown:
            self._compiled[key] = self._compile_for(chosen, inputs)
        return self._compiled[key]

    def jacobian(self, attribute: Attribute, variables: Sequence[Attribute]) -> sparse.csr_array[np.float64]:
        """First derivatives of an attribute by stored attributes, see `Scene.jacobian`."""
        from scipy import sparse

        assert attribute.owner is not None
        count, entries = attribute.owner.num_instances, attribute.size
        sizes = [variable.owner.num_instances * variable.size for variable in variables if variable.owner is not None]
        inputs = set(attribute.inputs)
        read = [variable for variable in variables if variable in inputs]
        if not read:
            return sparse.csr_array((count * entries, sum(sizes)))
        # The product of the attribute with weights has it as its gradient by these, so its mixed second derivatives by
        # weights and variables are the attribute's first ones.
        zeros = np.zeros((count, *attribute.shape))
        if attribute not in self._weights:
            weights = Attribute(attribute.owner, attribute.shape, Stored(zeros, constant=True))
            self._weights[attribute] = (weights, weights.dot(attribute))
        weights, product = self._weights[attribute]
        weights.update_value(zeros)
        energy = EnergyTerm(product, "none", attribute.owner.is_dynamic)
        compiled = self.of([energy], [weights, *read], exact=True)
        compiled.assemble()
        found = compiled.hessian().to_scipy()[: count * entries]
        blocks, start = [], count * entries
        for variable, size in zip(variables, sizes, strict=True):
            if variable in inputs:
                blocks.append(found[:, start : start + size])
                start += size
            else:
                blocks.append(sparse.csr_array((count * entries, size)))
        return sparse.csr_array(sparse.hstack(blocks))
