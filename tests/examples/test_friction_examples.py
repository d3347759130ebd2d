"""The arch, the card house and the dominoes as commands; what they do over a longer time is in tests/scenes."""

from __future__ import annotations

import itertools
from pathlib import Path

import ipctk
import numpy as np
import pytest

from yasps.examples import card_house, dominoes, masonry_arch


def test_the_stones_of_the_arch_are_as_far_apart_as_they_say() -> None:
    stones = masonry_arch.arch_stones(9)
    assert all((stone.volumes() > 0).all() for stone in stones)
    for left, right in itertools.pairwise(stones):
        joint, other = left.vertices[4:], right.vertices[:4]  # box counts along the arch first
        np.testing.assert_allclose(np.linalg.norm(joint - other, axis=1), masonry_arch.GAP, rtol=1e-9)
    feet = np.concatenate([stones[0].vertices[:4], stones[-1].vertices[4:]])
    np.testing.assert_allclose(feet[:, 2], masonry_arch.GAP)


@pytest.mark.parametrize("levels", [1, 2, 3, 4])
def test_the_cards_of_a_house_do_not_touch(levels: int) -> None:
    cards = card_house.cards_of_house(levels)
    assert len(cards) == levels * (levels + 1) + levels - 1
    assert min(card.vertices[:, 2].min() for card in cards) == pytest.approx(card_house.GAP)
    starts = np.cumsum([0, *(len(card.vertices) for card in cards)])
    edges = [card.surface_edges() + start for card, start in zip(cards, starts, strict=False)]
    triangles = [card.surface_triangles() + start for card, start in zip(cards, starts, strict=False)]
    vertices = np.concatenate([card.vertices for card in cards])
    mesh = ipctk.CollisionMesh(vertices, np.concatenate(edges), np.concatenate(triangles))
    assert not ipctk.has_intersections(mesh, vertices)


def test_a_house_without_friction_fails_its_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flags = ["--size", "1", "--friction", "0", "--frames", "4", "--headless", "--output", str(tmp_path)]
    assert card_house.main(flags) == 1
    assert "coefficient of friction of 0.0: the house does not stand" in capsys.readouterr().err


def test_checks_say_what_needs_more_frames(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flags = ["--size", "3", "--frames", "1", "--headless", "--output", str(tmp_path)]
    assert dominoes.main(flags) == 1
    assert "after 0.01 s only 0 of 3 dominoes have fallen; give it more --frames" in capsys.readouterr().err
    assert masonry_arch.main([*flags, "--friction", "0", "--frames", "0"]) == 1
    assert "the arch does not fall yet; give it more --frames" in capsys.readouterr().err
