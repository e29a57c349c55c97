"""Pictures of a scored bank."""

from pathlib import Path

import pytest

from physid.benchmark.scoring.pictures import draw_confusion, draw_power, draw_reliability, save


@pytest.mark.parametrize("draw", [draw_confusion, draw_power, draw_reliability])
def test_a_bank_without_anything_to_judge_still_has_its_pictures(draw, tmp_path: Path) -> None:  # noqa: ANN001
    save(draw([]), tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 0
