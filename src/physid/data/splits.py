"""Which trajectory is for what."""

from __future__ import annotations

from collections.abc import Mapping


def assign_splits(count: int, shares: Mapping[str, float]) -> list[str]:
    """Deal trajectories out to splits, so that any first part of them is balanced as well as it can be.

    Each trajectory goes to the split that lags most behind its share; more trajectories may thus be added later.

    Args:
        count: Number of trajectories.
        shares: Share of each split, in any unit; {"train": 9, "test": 1} gives every tenth trajectory to test.

    Returns:
        The split of each trajectory.
    """
    total = sum(shares.values())
    given = dict.fromkeys(shares, 0)
    splits = []
    for so_far in range(1, count + 1):
        chosen = max(shares, key=lambda name: shares[name] / total * so_far - given[name])
        given[chosen] += 1
        splits.append(chosen)
    return splits
