"""What each world of a group does next: which compliance it uses, where it aims, how far it goes."""

from __future__ import annotations

from physid.compiler.graph import Value, least, most, size, total, where
from physid.compiler.section import Record
from physid.physics.contact_problem.rounding import ROUNDING
from physid.physics.schemes.units import FINE, STANDARD_GRAVITY

WARM_STEPS = 8.0
"""Newton steps that a start from the previous solution may take before the solver starts afresh."""

POLISHED = 1e-2
"""A solution is improved by one more Newton step unless its error is this much below what is accepted."""

EPSILON = 2.0**-52
"""Of the numbers of the kernels, which are doubles."""

SHORT = 0.05
"""A step shorter than this tells that the previous solution misleads."""


def _rung(rung: Value, constants: Record) -> Value:
    """Return the compliance of a rung of the ladder."""
    ladder = constants["ladder"]
    value = ladder[0]
    for k, compliance in enumerate(ladder[1:], 1):
        value = where(rung >= float(k), compliance, value)
    return value


def set_unit(constants: Record, *, midpoint: bool) -> None:
    """Write the unit of velocities of a step of another length (see `physid.physics.schemes.units.velocity_unit`)."""
    step = constants.one("step")
    constants["unit"] = [STANDARD_GRAVITY * (most(step, FINE) if midpoint else step)]


def begin(lane: Record, constants: Record) -> None:
    """Begin with the previous solution if there is one; what is at hand is not known yet."""
    lane["speed"], lane["distance"] = [0.0], [0.0]
    known = lane.one("known") > 0.0
    rung = where(known, -1.0, 0.0)
    lane["rung"], lane["count"], lane["restart"] = [rung], [0.0], [where(known, 0.0, 1.0)]
    lane["compliance"] = [_rung(rung, constants)]
    lane["known"], lane["length"], lane["lost"] = [constants.one("unit")], [1.0], [0.0]
    lane["solved"] = [0.0]


def clear(lane: Record) -> None:
    """Forget the errors."""
    lane["worst"], lane["gap"] = [0.0], [0.0]


def gauge(body: Record, lane: Record) -> None:
    """Note the fastest motion of a point of a body, in units of g h."""
    turning, moving = (total([size(value) for value in body["free"][first : first + 3]]) for first in (0, 3))
    lane["speed"] = [most(lane.one("speed"), moving + 0.5 * turning * total(body["size"]))]


def allow(lane: Record, constants: Record) -> None:
    """Allow for the rounding of what is at hand: in sums, and in products on top of that."""
    speed, accepted = lane.one("speed"), constants.one("accepted")
    share = ROUNDING * EPSILON / accepted
    sums = 1.0 + share * (speed + lane.one("distance"))
    lane["allowed"], lane["allowed_products"] = [1.0 / sums], [sums / most(1.0 + share * (speed * speed), sums)]


def check(lane: Record, constants: Record) -> None:
    """Decide who is done, who goes on, and who starts again with the next compliance."""
    rung, count = lane.one("rung"), lane.one("count")
    worst = lane.one("worst") * lane.one("allowed")
    solved = worst <= constants.one("accepted")
    going = ~(worst <= POLISHED * constants.one("accepted")) & ~(solved & (lane.one("solved") > 0.5))
    lane["worst"] = [worst]
    lane["solved"] = [where(solved, 1.0, 0.0)]
    misled = (count >= WARM_STEPS) | (lane.one("lost") > 0.5) | ((count > 0.0) & (lane.one("length") < SHORT))
    warm = rung < 0.0
    # What was solved by the last step that it had is polished too, as the reference does; it is not tried again.
    spent = ~solved & ((warm & misled) | (~warm & (count >= constants.one("max_steps"))))
    retry = going & spent & (rung + 1.0 < constants.one("rungs"))
    rung = where(retry, rung + 1.0, rung)
    lane["rung"], lane["count"], lane["restart"] = [rung], [where(retry, 0.0, count)], [where(retry, 1.0, 0.0)]
    lane["compliance"] = [_rung(rung, constants)]
    lane["active"] = [where(going & (~spent | retry), 1.0, 0.0)]
    lane["predicts"] = [where(going & (~spent | retry) & (rung >= 0.0), 1.0, 0.0)]


def _aim(lane: Record, target: Value) -> None:
    lane["target"] = [target]
    lane["numerator"], lane["denominator"], lane["slope"], lane["curve"] = [2.0], [1.0], [0.0], [0.0]


def aim_at_zero(lane: Record, constants: Record) -> None:
    """Look where the undamped Newton direction leads."""
    _aim(lane, constants.one("tau") * 0.0)


def aim_at_end(lane: Record, constants: Record) -> None:
    """Go straight to z o w = tau."""
    _aim(lane, constants.one("tau"))


def aim(lane: Record, constants: Record) -> None:
    """Centre as much as the undamped direction fell short, sigma = max(sigma_affine^3, 0.1)."""
    tau, gap = constants.one("tau"), lane.one("gap")
    length = least(lane.one("numerator") / lane.one("denominator"), 1.0)
    predicted = total([gap, length * lane.one("slope"), length * length * lane.one("curve")])
    share = least(most(predicted / gap, 0.0), 1.0)
    sigma = most(share * share * share, 0.1)
    centred = most(sigma * gap / constants.one("pairs"), tau)
    _aim(lane, where(lane.one("rung") < 0.0, tau, centred))


def decide_length(lane: Record) -> None:
    """Stay strictly inside the cones."""
    active = lane.one("active")
    longest = lane.one("numerator") / lane.one("denominator")
    lane["length"] = [least(0.99 * longest, 1.0) * active]
    lane["count"] = [lane.one("count") + active]


def report(lane: Record, outcome: Record) -> None:
    """Keep the largest error of the steps of a frame."""
    worst, error = outcome.one("worst"), lane.one("worst")
    outcome["worst"] = [where(error <= worst, worst, error)]
