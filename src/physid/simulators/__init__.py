"""Simulators that make recordings and serve as references; each behind the same functions."""

from physid.simulators.motion import Motion as Motion
from physid.simulators.motion import observed as observed
from physid.simulators.protocol import SIMULATORS as SIMULATORS
from physid.simulators.protocol import Simulator as Simulator
from physid.simulators.protocol import find_simulator as find_simulator
from physid.simulators.sampling import MOST_JITTER as MOST_JITTER
from physid.simulators.sampling import Sampling as Sampling
from physid.simulators.sampling import sample as sample
