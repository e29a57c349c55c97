"""Effects of actuation: between the command and the force that acts."""

from __future__ import annotations

from physid.effects.actuation.force_dead_zone import ForceDeadZone
from physid.effects.actuation.force_delay import ForceDelay
from physid.effects.actuation.force_gain import ForceGain
from physid.effects.actuation.force_lag import ForceLag
from physid.effects.actuation.force_misalignment import ForceMisalignment
from physid.effects.actuation.force_offset import ForceOffset
from physid.effects.actuation.force_saturation import ForceSaturation
from physid.physics import Effect

EFFECTS: tuple[type[Effect], ...] = (
    ForceGain,
    ForceDeadZone,
    ForceSaturation,
    ForceDelay,
    ForceLag,
    ForceMisalignment,
    ForceOffset,
)
