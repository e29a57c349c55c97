"""physid identifies the physical parameters of objects from video and known forces."""

from importlib.metadata import version

__version__ = version("physid")
