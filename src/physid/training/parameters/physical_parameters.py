"""Physical parameters that are learned, by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import final

import torch
from torch import Tensor, nn

from physid.estimation.prediction.nominal_model import NominalModel
from physid.physics.layer import PhysicsLayer
from physid.physics.parameters import Parameters
from physid.scenes.parameters import bodies_of, highest_value, with_parameters
from physid.scenes.scene import Scene

FIELDS = ("mass", "friction", "restitution")


@final
class PhysicalParameters(nn.Module):
    """Masses, friction and restitution of the bodies of a scene; some are learned, as logarithms of positive numbers.

    A name such as "block.friction" sets the friction of every body of that material. The inertia follows the mass.

    Args:
        scene: The scene as far as it is known; its values are the first guess of what is learned.
        learn: Names of the parameters to learn; None for the scene's unknown ones.
        values: Values that replace the scene's, by name: another first guess, or better knowledge of a fixed one.

    Attributes:
        names: The learned parameters.
        scene: The scene, in which they are unknown.
        logarithm: Natural logarithms of their values, shape (P,), float64.

    Raises:
        ValueError: If a name does not exist, two names set the same value, nothing is to be learned, or a first guess
            is not positive.
    """

    size: Tensor
    mass: Tensor
    inertia: Tensor
    friction: Tensor
    restitution: Tensor
    _highest: Tensor

    def __init__(
        self, scene: Scene, learn: Iterable[str] | None = None, values: Mapping[str, float] | None = None
    ) -> None:
        super().__init__()
        scene = with_parameters(scene, values or {})
        self.names = tuple(scene.unknown if learn is None else learn)
        self._places = tuple((bodies_of(scene, name), scene.locate(name)[1]) for name in self.names)
        self._check(scene)
        self.scene = dataclasses.replace(scene, unknown=self.names)
        self._hold("size", scene.sizes)
        self._hold("inertia", [body.moments() for body in scene.bodies])
        for field in FIELDS:
            self._hold(field, [getattr(body, field) for body in scene.bodies])
        guess = torch.tensor([scene.value(name) for name in self.names], dtype=torch.float64)
        self.logarithm = nn.Parameter(guess.log())
        highest = torch.tensor([highest_value(name) for name in self.names], dtype=torch.float64)
        self.register_buffer("_highest", highest.log(), persistent=False)

    def _hold(self, name: str, value: object) -> None:
        """Keep a known value (1, N, ...); it is rebuilt from the scene, hence not part of a checkpoint."""
        import numpy as np

        self.register_buffer(name, torch.from_numpy(np.array(value, dtype=np.float64))[None], persistent=False)

    def _check(self, scene: Scene) -> None:
        """Refuse parameters that cannot be learned."""
        if not self.names:
            raise ValueError(f"scene {scene.name} names no unknown parameter; say what to learn, say [block.friction]")
        seen: dict[tuple[int, str], str] = {}
        for name, (bodies, field) in zip(self.names, self._places, strict=True):
            for body in bodies:
                other = seen.setdefault((body, field), name)
                if other != name:
                    raise ValueError(f"{name} and {other} set the same value, one material: learn one of them")
            if scene.value(name) <= 0:
                raise ValueError(
                    f"the first guess of {name} must be positive, got {scene.value(name)}; set it in values"
                )

    def forward(self, logarithm: Tensor | None = None) -> Parameters:
        """Build the parameters of all bodies.

        Args:
            logarithm: Other logarithms than the learned ones, of shape (P,), or (K, P) for K worlds at once.

        Returns:
            Parameters with a batch axis of 1, or of K.
        """
        logarithm = self.logarithm if logarithm is None else logarithm
        value = logarithm.reshape(-1, len(self.names)).exp()
        fields = {field: getattr(self, field).expand(len(value), -1) for field in FIELDS}
        for column, (bodies, field) in enumerate(self._places):
            mine = torch.zeros(fields[field].shape[1], dtype=torch.bool, device=value.device)
            mine[list(bodies)] = True
            fields[field] = torch.where(mine, value[:, column : column + 1], fields[field])
        inertia = self.inertia * (fields["mass"] / self.mass)[..., None]
        return Parameters(size=self.size, inertia=inertia, **fields)

    @torch.no_grad()
    def confine(self) -> None:
        """Bring what a step of an optimizer led out of its physical range back to the end of it.

        With a restitution above 1 every bounce makes energy, until no contact can be solved any more.
        """
        self.logarithm.clamp_(max=self._highest.to(self.logarithm))

    def model(self, layer: PhysicsLayer) -> NominalModel:
        """Return the same for `physid.estimation`, whose coordinates are then the logarithms."""
        return NominalModel(self.scene, layer.effects, rules=layer.world, logarithmic=True)

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
        return dict(zip(self.names, self.logarithm.detach().exp().tolist(), strict=True))
