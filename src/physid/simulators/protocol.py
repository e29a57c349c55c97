"""What a simulator is, and those there are."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Protocol

from physid.scenes import Excitation, Scene
from physid.strict import nearest

if TYPE_CHECKING:
    from physid.physics import Effect
    from physid.simulators.motion import Motion

BULLET_STEP = 1 / 240  # [s] the longest step that is asked of PyBullet


class Simulator(Protocol):
    """Makes motions of a scene: a reference that knows nothing of the PhysicsLayer.

    Attributes:
        name: What configurations call it.
        from_any_state: Whether it knows every motion of a scene, from any state and with any effect of the catalogue.
        own_laws: Effects that it imitates by a law of its own, which is not that of the catalogue.
    """

    @property
    def name(self) -> str: ...  # noqa: D102

    @property
    def from_any_state(self) -> bool: ...  # noqa: D102

    @property
    def own_laws(self) -> frozenset[str]: ...  # noqa: D102

    def simulate(
        self,
        scene: Scene,
        excitations: Sequence[Excitation],
        effects: Sequence[Effect] = (),
        substeps: int | None = None,
        clocks: Sequence[float] | None = None,
    ) -> list[Motion]:
        """Simulate a scene under several force sequences.

        Row t of a wrench is held from frame t to frame t+1, `scene.time_step` later; the last row is not used. Effects
        change the commanded wrenches before they act and the inputs of each step; what they do to the observed
        pose is not part of the motion. Bodies start exactly where excitations say, however large effects make them:
        who draws an excitation lays bodies on the ground with the sizes that they have (`scenes.lying.raise_lying`).

        Args:
            scene: The scene, with the parameters to simulate.
            excitations: First states and commanded wrenches, of any lengths.
            effects: Effects of the catalogue, used unchanged, in this order; parameters of shape (1,).
            substeps: Steps of the simulator between two frames; None for what `substeps_for` says.
            clocks: Times that effects see at the first frames [s]; None for 0.

        Returns:
            The motion of each.

        Raises:
            ValueError: If an excitation does not fit the scene, an effect cannot be simulated, or a motion is not
                finite.
        """
        ...

    def substeps_for(self, time_step: float) -> int:
        """Return how many steps it takes by default between frames that are `time_step` [s] apart."""
        ...

    def integration(self, step: float) -> Mapping[str, str | float] | None:
        """Return scheme and step [s] where recordings share them with the model, None where nothing is shared."""
        ...


@dataclass(frozen=True)
class _Simulator:
    """A simulator behind the functions of its package, which is imported when it is first asked."""

    name: str
    longest_step: float
    package: str
    scheme: str | None = None
    from_any_state: bool = True
    own_laws: frozenset[str] = frozenset()

    def simulate(
        self,
        scene: Scene,
        excitations: Sequence[Excitation],
        effects: Sequence[Effect] = (),
        substeps: int | None = None,
        clocks: Sequence[float] | None = None,
    ) -> list[Motion]:
        """Simulate (see `Simulator.simulate`)."""
        count = self.substeps_for(scene.time_step) if substeps is None else substeps
        motions: list[Motion] = import_module(self.package).simulate_all(scene, excitations, effects, count, clocks)
        return motions

    def substeps_for(self, time_step: float) -> int:
        """Return the number of steps that makes them at most `longest_step` long."""
        return max(1, math.ceil(time_step / self.longest_step - 1e-9))

    def integration(self, step: float) -> Mapping[str, str | float] | None:
        """Return scheme and step [s], where there are any to share."""
        return None if self.scheme is None else {"scheme": self.scheme, "step": step}


SIMULATORS: tuple[Simulator, ...] = (
    _Simulator(
        *("pybullet", BULLET_STEP, "physid.simulators.bullet.world", "semi_implicit_euler"),
        # Its spring takes up what should bounce; its friction under a load that leans turns a block.
        own_laws=frozenset({"contact_compliance", "com_offset"}),
    ),
    _Simulator("mujoco", 1e-3, "physid.simulators.mujoco.world"),
    _Simulator("closed_form", math.inf, "physid.simulators.closed_form.world", from_any_state=False),
)


def find_simulator(name: str) -> Simulator:
    """Return a simulator by name.

    Raises:
        ValueError: If there is no such simulator.
    """
    known = {simulator.name: simulator for simulator in SIMULATORS}
    if name not in known:
        raise ValueError(f'unknown simulator "{name}"{nearest(name, known)}')
    return known[name]
