"""MuJoCo: the only package that imports it."""

try:
    import mujoco
except ImportError as error:
    raise ValueError(
        "the simulator mujoco needs the package mujoco-core, which is not installed; pip install mujoco-core"
    ) from error

# Motions that are not finite are refused in words of our own; MuJoCo would write a log file where it is run.
mujoco.set_mju_user_warning(lambda text: None)
