"""What the user believes of the system: the nominal model, from a configuration, a run or a checkpoint."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import Tensor

from physid.data.files import read_tensors
from physid.estimation.prediction import NominalModel
from physid.estimation.prediction.coordinates import LEARNED, Coordinates, is_effect, sorted_out, with_first_sizes
from physid.one_writer import CHECKPOINT
from physid.scenes import Scene, with_parameters
from physid.strict import LARGEST, joined, number, shown, whole
from physid.yaml_files import read_yaml

CONFIG = "config.yaml"
COORDINATES, EARLIER = "physical.coordinates", "physical.logarithm"
"""Where a checkpoint of SysID keeps what was learned, now and before effects were."""


@dataclass(frozen=True)
class Fitted:
    """What a checkpoint holds: coordinates, and the parameters that they are of; None where an older one says none."""

    coordinates: Tensor
    names: tuple[str, ...] | None

    def values(self, learned: Sequence[str]) -> dict[str, float]:
        """Return fitted values by name, given what the model learns.

        Raises:
            ValueError: If they are of other parameters.
        """
        names = tuple(learned) if self.names is None else self.names
        if not {*learned} >= {*names} or len(self.coordinates) != len(names):
            found = ", ".join(map(shown, self.names)) if self.names else len(self.coordinates)
            raise ValueError(f"expected {len(learned)} fitted parameters ({', '.join(learned)}), found {found}")
        return dict(zip(names, Coordinates.of(names).to_values(self.coordinates).tolist(), strict=True))


def read_nominal_model(scene: Scene, source: Path | Mapping[str, Any] | None) -> NominalModel:
    """Build the nominal model.

    Of a configuration of `physid fit` with SysID these keys count: `model.learn` (what is unknown), `model.values`
    (better values than those of recording.yaml), `model.engine.substeps` and `model.engine.effects`. A run or its
    checkpoint gives the values that were fitted as well, each to the parameter that it was fitted for; the diagnosis
    refits them, beside what recording.yaml calls unknown where the configuration does not say what is.

    Args:
        scene: The scene as recording.yaml describes it.
        source: A configuration (a file without `base`, or its content), a folder of a run, a checkpoint in it, or None.

    Raises:
        ValueError: If the source is none of these, or names what the scene does not have.
    """
    if source is None:
        return NominalModel(scene)
    config, place, fitted = _read(source)
    known = _without_classes(_mapping(config.get("model"), f"{place}: model"))
    values = joined(_mapping(known.get("values"), f"{place}: model.values"), f"{place}: model.values")
    learn = known.get("learn")
    if learn is None:
        learn = list(dict.fromkeys((*(fitted.names or () if fitted else ()), *scene.unknown)))
    if not isinstance(learn, list | tuple) or not all(isinstance(name, str) for name in learn):
        raise ValueError(f"{place}: model.learn: expected parameters such as [block.mass], got {shown(learn)}")
    engine = _mapping(known.get("engine"), f"{place}: model.engine")
    substeps = engine.get("substeps")
    try:
        values = {str(name): number(value, f"model.values.{name}") for name, value in values.items()}
        if substeps is not None:
            whole(substeps, "model.engine.substeps", low=1, high=LARGEST["substeps"])
        bodies, sizes = sorted_out(learn, scene)
        values |= fitted.values((*bodies, *sizes)) if fitted else {}
        of_effects = {name: values.pop(name) for name in list(values) if is_effect(name)}
        scene = dataclasses.replace(with_parameters(scene, values), unknown=bodies)
        effects = with_first_sizes(dict(_effects(engine.get("effects"))), sizes, of_effects)
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from None
    return NominalModel(scene, effects, substeps, sizes=sizes)


def _effects(given: object) -> list[tuple[str, dict[str, float]]]:
    """Return the parameters of each effect by its name."""
    named = _mapping(given, "model.engine.effects").items()
    return [
        (str(name), {str(key): number(value, f"{name}.{key}") for key, value in _mapping(each, str(name)).items()})
        for name, each in named
    ]


def _mapping(given: object, where: str) -> Mapping[str, Any]:
    """Return a mapping; an empty one for nothing."""
    if given is not None and not isinstance(given, Mapping):
        raise ValueError(f"{where}: expected a mapping, got {shown(given)}")
    return given or {}


def _read(source: Path | Mapping[str, Any]) -> tuple[Mapping[str, Any], str, Fitted | None]:
    """Return a configuration, what it is called, and what was fitted where there is a checkpoint."""
    if isinstance(source, Mapping):
        return source, "model", None
    if source.is_dir():
        return _read(source / CHECKPOINT)
    if source.suffix == ".ckpt":
        if not source.is_file():
            raise ValueError(f"{source} does not exist: expected a run of `physid fit`, or its checkpoint")
        content = read_tensors(source, ("state_dict",))
        state, names = content["state_dict"], content.get(LEARNED)
        found = state.get(COORDINATES, state.get(EARLIER))
        if not isinstance(found, Tensor):
            raise ValueError(f"{source}: expected a checkpoint of SysID with {COORDINATES}, found none")
        if names is not None and not (isinstance(names, list) and all(isinstance(each, str) for each in names)):
            raise ValueError(f"{source}: expected names of parameters ({LEARNED}), found something else")
        config = source.parent.parent / CONFIG
        return _yaml(config), str(source), Fitted(found.double(), None if names is None else tuple(names))
    return _yaml(source), str(source), None


def _yaml(path: Path) -> Mapping[str, Any]:
    if not path.is_file():
        raise ValueError(f"{path} does not exist: expected a configuration of `physid fit`")
    content = read_yaml(path)
    if not isinstance(content, Mapping):
        raise ValueError(f"{path}: expected a configuration of `physid fit`, found {type(content).__name__}")
    return content


def _without_classes(node: Any) -> Any:
    """Merge `init_args` into the mapping they stand in, at all levels."""
    if not isinstance(node, Mapping):
        return node
    merged = {key: value for key, value in node.items() if key not in ("class_path", "init_args")}
    merged |= _mapping(node.get("init_args"), "init_args")
    return {key: _without_classes(value) for key, value in merged.items()}
