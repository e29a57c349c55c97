"""Settings of what a diagnosis starts from: the roles of trajectories."""

from __future__ import annotations

from physid.setting import Section, setting


class RoleSettings(Section):
    """Which part a trajectory plays."""

    probes_from: int = setting(
        4, "trajectories", "of another protocol, from which on every second one joins the fit as a probe", ge=2
    )
    select_every: int = setting(
        3, "trajectories", "of so many fitted ones the last selects, where no split says which", ge=2
    )
