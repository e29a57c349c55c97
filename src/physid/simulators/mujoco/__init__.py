"""MuJoCo: the only package that imports it."""

try:
    import mujoco  # noqa: F401
except ImportError as error:
    raise ValueError(
        "the simulator mujoco needs the package mujoco-core, which is not installed; pip install mujoco-core"
    ) from error
