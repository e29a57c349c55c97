"""Physical parameters that are learned, by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, final

import torch
from torch import Tensor, nn

from physid.estimation.prediction import NominalModel
from physid.estimation.prediction.coordinates import Coordinates, is_effect, sorted_out, with_first_sizes
from physid.physics import Effect, Parameters, PhysicsLayer
from physid.scenes import Scene, bodies_of, with_parameters

EARLIER = "logarithm"  # what checkpoints called the coordinates while all of them were logarithms


@final
class PhysicalParameters(nn.Module):
    """Masses, friction and restitution of the bodies of a scene, and sizes of effects; some are learned.

    A name such as "block.friction" sets the friction of every body of that material; the inertia follows the mass.
    A name such as "viscous_drag.coefficient" sets a parameter of an effect of the catalogue. What is learned are
    coordinates: logarithms of the parameters of bodies, and sizes of effects in typical ones (see `Coordinates`).

    Args:
        scene: The scene as far as it is known; its values are the first guess of what is learned.
        learn: Names of the parameters to learn; None for the scene's unknown ones.
        values: Values that replace the scene's, by name: another first guess, or better knowledge of a fixed one. Of
            effects first guesses only; without one, a fit begins with a tenth of what is typical.
        effects: Effects at work, with their values; those that are learned may be among them, or not.

    Attributes:
        names: The learned parameters, those of bodies first.
        scene: The scene, in which they are unknown.
        effects: Effects at work, learned ones included, with first guesses.
        coordinates: The present point, shape (P,), float64.

    Raises:
        ValueError: If a name does not exist, two names set the same value, nothing is to be learned, or a first guess
            is not positive.
    """

    def __init__(
        self,
        scene: Scene,
        learn: Iterable[str] | None = None,
        values: Mapping[str, float] | None = None,
        effects: Sequence[Effect] = (),
    ) -> None:
        super().__init__()
        given = {name: value for name, value in (values or {}).items() if is_effect(name)}
        scene = with_parameters(scene, {name: value for name, value in (values or {}).items() if name not in given})
        bodies, sizes = sorted_out(scene.unknown if learn is None else learn, scene)
        _check(scene, bodies, sizes, given)
        self.names = (*bodies, *sizes)
        known = {effect.name: {name: float(value) for name, value in effect.values().items()} for effect in effects}
        self.scene, self.effects = dataclasses.replace(scene, unknown=bodies), with_first_sizes(known, sizes, given)
        self._model = NominalModel(self.scene, self.effects, logarithmic=True, sizes=sizes)
        self.coordinates = nn.Parameter(self._model.guess)
        self.register_load_state_dict_pre_hook(_take_earlier)  # type: ignore[no-untyped-call]

    def forward(self, coordinates: Tensor | None = None) -> Parameters:
        """Build the parameters of all bodies, and the sizes of effects that are learned.

        Args:
            coordinates: Others than the present ones, of shape (P,), or (K, P) for K worlds at once.

        Returns:
            Parameters with a batch axis of 1, or of K.
        """
        coordinates = self.coordinates if coordinates is None else coordinates
        point = coordinates.reshape(-1, len(self.names))
        return self._model.parameters(point).replace(sizes=self._model.sizes_at(point))

    @property
    def space(self) -> Coordinates:
        """What the coordinates stand for."""
        return self._model.coordinates

    @torch.no_grad()
    def confine(self) -> None:
        """Bring what a step of an optimizer led out of its physical range back to the end of it.

        With a restitution above 1 every bounce makes energy, until no contact can be solved any more.
        """
        self.coordinates.copy_(self.space.within(self.coordinates))

    def model(self, layer: PhysicsLayer) -> NominalModel:
        """Return the same for `physid.estimation`, with the effects of the physics, learned ones among them."""
        return dataclasses.replace(self._model, effects=layer.effects, rules=layer.world)

    @staticmethod
    def of(module: nn.Module) -> PhysicalParameters:
        """Return the physical parameters of a training module, its attribute `physical`.

        Raises:
            TypeError: If it has none.
        """
        physical = getattr(module, "physical", None)
        if not isinstance(physical, PhysicalParameters):
            raise TypeError(f"{type(module).__name__} has no physical parameters to follow")
        return physical

    def estimates(self) -> dict[str, float]:
        """Return the present values of the learned parameters by name."""
        return dict(zip(self.names, self._model.to_values(self.coordinates.detach()).tolist(), strict=True))

    def estimated_scene(self) -> Scene:
        """Return the scene with the present values of what is learned of bodies."""
        return self._model.scene_at(self.coordinates.detach())


def _check(scene: Scene, bodies: Sequence[str], sizes: Sequence[str], given: Mapping[str, float]) -> None:
    """Refuse parameters that cannot be learned."""
    if not bodies and not sizes:
        raise ValueError(f"scene {scene.name} names no unknown parameter; say what to learn, say [block.friction]")
    seen: dict[tuple[int, str], str] = {}
    for name in bodies:
        for body in bodies_of(scene, name):
            other = seen.setdefault((body, scene.locate(name)[1]), name)
            if other != name:
                raise ValueError(f"{name} and {other} set the same value, one material: learn one of them")
        if scene.value(name) <= 0:
            raise ValueError(f"the first guess of {name} must be positive, got {scene.value(name)}; set it in values")
    for name in given:
        if name not in sizes:
            raise ValueError(
                f"values.{name}: expected an effect that is learned, or a parameter of a body; what is known of an "
                "effect stands in model.engine.effects"
            )


def _take_earlier(module: nn.Module, state: dict[str, Any], prefix: str, *_: Any) -> None:
    """Take the coordinates from a checkpoint of before there were others than logarithms."""
    if f"{prefix}{EARLIER}" in state:
        state[f"{prefix}coordinates"] = state.pop(f"{prefix}{EARLIER}")
