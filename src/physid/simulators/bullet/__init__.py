"""PyBullet: the only package that imports it."""

import os


def _import_quietly() -> None:
    """Import PyBullet without the line that its C code prints on the error stream each time."""
    saved, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        import pybullet  # noqa: F401
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(nowhere)


_import_quietly()
