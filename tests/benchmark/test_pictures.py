"""Pictures of a scored bank."""

from pathlib import Path

import pytest

from physid.benchmark.scoring.pictures import draw_confusion, draw_power, draw_reliability
from physid.data.files import write_picture


@pytest.mark.parametrize("draw", [draw_confusion, draw_power, draw_reliability])
def test_a_bank_without_anything_to_judge_still_has_its_pictures(draw, tmp_path: Path) -> None:  # noqa: ANN001
    data = write_picture(tmp_path / "picture.png", draw([]))
    assert (tmp_path / "picture.png").read_bytes() == data
    assert data.startswith(b"\x89PNG")
