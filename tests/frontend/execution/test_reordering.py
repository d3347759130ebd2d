"""The solver's own order of unknowns: a mesh with mixed vertices behaves like the same mesh with tidy ones."""

from __future__ import annotations

import numpy as np
import pytest

from yasps import Scene
from yasps.runtime.matrix import block_matrix

POINTS = 60


def chain(names: np.ndarray) -> Scene:
    """Springs along a chain whose k-th point is called names[k], with a weight on each, dynamic ties between far ones,
    and a second target of another shape tied to the first point."""
    scene = Scene("chain")
    mesh, body = scene.add_mesh("mesh"), scene.add_mesh("body")
    points, frames = mesh.add_primitive("points", POINTS), body.add_primitive("frames", 2)
    values = np.empty((POINTS, 3))
    values[names] = np.random.default_rng(0).uniform(-0.2, 0.2, (POINTS, 3)) + np.arange(POINTS)[:, None] * [1, 0.3, 0]
    x = points.add_attribute("x", 3, 1, value=values)
    y = frames.add_attribute("y", 2, 1, value=[0.3, -0.2, 0.1, 0.5])
    scene.add_energy(points.add_attribute("weight", computed_attribute=0.5 * x.dot(x)))
    scene.add_energy(frames.add_attribute("rest", computed_attribute=y.dot(y)))

    links = mesh.add_primitive("links", POINTS - 1)
    ends = links.add_connectivity("ends", points, np.stack([names[:-1], names[1:]], 1), 2)
    both = links.add_attribute("both", through=ends, source=x)
    strain = (both.row(1) - both.row(0)).norm() - 0.9
    scene.add_energy(links.add_attribute("spring", computed_attribute=50.0 * strain * strain))

    ties = scene.add_mesh("ties").add_primitive("ties", 2)
    points_of = ties.add_connectivity("points", points, names[[0, 40]], 1)
    frames_of = ties.add_connectivity("frames", frames, [1, 0], 1)
    gap = (
        ties.add_attribute("x", through=points_of, source=x)[0]
        - ties.add_attribute("y", through=frames_of, source=y)[1]
    )
    scene.add_energy(ties.add_attribute("tie", computed_attribute=gap * gap))

    far = mesh.add_primitive("far", 3)
    pairs = far.add_connectivity("pairs", points, names[[0, 40, 5, 33, 59, 7]].reshape(3, 2), 2)
    both = far.add_attribute("both", through=pairs, source=x)
    gap = both.row(1) - both.row(0)
    scene.add_energy(far.add_attribute("stretch", computed_attribute=0.1 * gap.dot(gap)), dynamic_instances=True)
    scene.add_minimize_target([x, y])
    return scene


@pytest.fixture
def scenes(monkeypatch: pytest.MonkeyPatch) -> tuple[Scene, Scene, np.ndarray]:
    """The tidy scene, the mixed one whose matrices are reordered, and where unknowns of the first are in the second."""
    monkeypatch.setattr(block_matrix, "FEWEST_BLOCKS", 0)
    names = np.random.default_rng(1).permutation(POINTS)
    place = np.concatenate([(3 * names[:, None] + np.arange(3)).reshape(-1), 3 * POINTS + np.arange(4)])
    return chain(np.arange(POINTS)), chain(names), place


def test_derivatives(scenes: tuple[Scene, Scene, np.ndarray]) -> None:
    tidy, mixed, place = scenes
    np.testing.assert_allclose(np.concatenate(mixed.gradient())[place], np.concatenate(tidy.gradient()), atol=1e-12)
    hessian = mixed.hessian()
    order = mixed.compile().static_matrix.order
    assert order is not None
    assert not np.array_equal(order, np.arange(POINTS + 2))
    dense = hessian.to_scipy().toarray()
    np.testing.assert_allclose(dense[np.ix_(place, place)], tidy.hessian().to_scipy().toarray(), atol=1e-12)

    upper = np.zeros_like(dense)
    for block in hessian.blocks:
        assert (block.rows <= block.cols).all()
        for row, col, values in zip(block.rows, block.cols, block.values, strict=True):
            upper[row : row + values.shape[0], col : col + values.shape[1]] += values
    np.testing.assert_array_equal(np.triu(upper), np.triu(dense))


@pytest.mark.parametrize("solver", ["pcg", "direct"])
def test_newton_step_while_dynamic_connectivity_changes(scenes: tuple[Scene, Scene, np.ndarray], solver: str) -> None:
    tidy, mixed, place = scenes
    names = place[: 3 * POINTS : 3] // 3
    for pairs in ([0, 40, 5, 33, 59, 7], [3, 4, 58, 1, 20, 30]):
        steps = []
        for scene, name in ((tidy, np.arange(POINTS)), (mixed, names)):
            scene.mesh.far.connectivities["pairs"].update_value(name[pairs])
            steps.append(np.concatenate(scene.minimize_energy(1e-24, solver=solver)))
        np.testing.assert_allclose(steps[1][place], steps[0], rtol=1e-9, atol=1e-10)
