"""Identify the friction of a pushed block from its path, in twenty lines of Python.

PyBullet pushes a block with known forces. The PhysicsLayer starts at twice the friction and follows its gradient until
its path is PyBullet's. Run it: python examples/identify_friction.py
"""

import numpy as np
import torch

from physid.physics import Parameters, PhysicsLayer, State, World
from physid.scenes import find_setup
from physid.simulators.bullet.world import simulate

STEPS = 200
TOLERANCE = 1e-3


def main() -> None:
    """Simulate, fit and check."""
    setup = find_setup("push")
    scene = setup.scene
    excitation = setup.draw(scene, "paper", np.random.default_rng(0), STEPS)
    recorded = torch.from_numpy(simulate(scene, excitation).pose)[None]

    truth, block = scene.bodies[0].friction, scene.bodies[0]
    start = State.at_rest(recorded[:, 0])
    wrenches = torch.from_numpy(excitation.wrench)[None, :-1]
    size, mass = torch.tensor([[block.size]]).double(), torch.tensor([[block.mass]]).double()
    logarithm = torch.tensor([[2 * truth]], dtype=torch.float64).log().requires_grad_()
    layer = PhysicsLayer(World(time_step=scene.time_step))
    optimizer = torch.optim.LBFGS([logarithm], max_iter=20, line_search_fn="strong_wolfe", tolerance_change=1e-14)

    def loss() -> torch.Tensor:
        optimizer.zero_grad()
        rollout = layer.rollout(start, wrenches, Parameters.of_boxes(size, mass, logarithm.exp()))
        error = (rollout.pose - recorded)[..., :3].square().sum(-1).mean()
        error.backward()
        return error

    optimizer.step(loss)
    estimate = float(logarithm.detach().exp())
    print(f"friction: first guess {2 * truth:.3f}, identified {estimate:.6f}, true {truth:.6f}")
    if abs(estimate / truth - 1) > TOLERANCE:
        raise SystemExit(f"the estimate is off by {estimate / truth - 1:.2%}; at most {TOLERANCE:.1%} is right")


if __name__ == "__main__":
    main()
