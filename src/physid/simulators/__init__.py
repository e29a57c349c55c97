"""Simulators that make recordings and serve as references; each behind the same functions."""

from physid.simulators.motion import Motion, observed
from physid.simulators.protocol import SIMULATORS, Simulator, find_simulator
from physid.simulators.sampling import Sampling

__all__ = ["SIMULATORS", "Motion", "Sampling", "Simulator", "find_simulator", "observed"]
