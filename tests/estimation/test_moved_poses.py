"""Moving poses and taking their difference undo each other."""

from __future__ import annotations

import torch

from physid.estimation.measurement import moved, pose_difference


def test_a_difference_leads_from_a_pose_to_the_other_and_back() -> None:
    generator = torch.Generator().manual_seed(0)
    pose = torch.randn(40, 2, 7, generator=generator, dtype=torch.float64)
    pose[..., 3:] = torch.nn.functional.normalize(pose[..., 3:], dim=-1)
    change = torch.randn(40, 2, 6, generator=generator, dtype=torch.float64)
    change[..., :3] *= 3 / change[..., :3].norm(dim=-1, keepdim=True)  # nearly half a turn
    assert torch.allclose(pose_difference(moved(pose, change), pose), change, atol=1e-9)
    assert pose_difference(moved(moved(pose, change), -change), pose).abs().max() < 1e-9
    assert torch.equal(moved(pose, torch.zeros_like(change))[..., :3], pose[..., :3])
