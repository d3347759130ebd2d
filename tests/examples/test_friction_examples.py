"""The arch, the card house and the dominoes as commands; what they do over a longer time is in tests/scenes."""

from __future__ import annotations

import itertools
from pathlib import Path

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


def test_few_stones_fall_without_friction(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--friction", "0", "--stones", "3", "--frames", "12", "--no-pictures", "--output", str(tmp_path)]
    assert masonry_arch.main(options) == 0
    lower = float(capsys.readouterr().out.split("the crown is ")[1].split(" mm")[0])
    assert lower > 5.0
    assert (tmp_path / "masonry_arch.vtkhdf").exists()


def test_the_card_house_has_seven_cards_that_do_not_touch() -> None:
    cards = card_house.cards_of_house()
    assert len(cards) == 7
    assert min(card.vertices[:, 2].min() for card in cards) == pytest.approx(card_house.GAP)


@pytest.mark.nightly
def test_the_commands_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert card_house.main(["--frames", "2", "--no-pictures", "--output", str(tmp_path)]) == 0
    assert "the house is" in capsys.readouterr().out
    assert dominoes.main(["--dominoes", "3", "--frames", "100", "--no-pictures", "--output", str(tmp_path)]) == 0
    assert "3 of 3 dominoes have fallen" in capsys.readouterr().out
    assert dominoes.main(["--dominoes", "3", "--frames", "1", "--no-pictures", "--output", str(tmp_path)]) == 1
