"""What lies where: the records between which the sections of a step work."""

from __future__ import annotations

from physid.compiler.section import Layout
from physid.physics.effect import widths_of

CONSTANTS = Layout(
    step=1,  # h [s]
    single_step=1,  # length of the steps of a simulator that is followed [s]; 0 for that of each step
    unit=1,  # g h [m/s], the unit of velocities
    gyroscopic=1,  # 1 or 0
    speculative=1, split=1,  # 1 for the rule of contact in force, or 0
    correction=1,
    speed_limit=1,
    slop=1,
    tau=1,
    accepted=1,
    max_steps=1,
    rungs=1,  # number of compliances
    pairs=1,  # number of products z w
    ladder=8,
)  # fmt: skip
CONSTANTS.constant = frozenset(range(CONSTANTS.slots))
OF_BODY, OF_WORLD = widths_of("body"), widths_of("ground", "world")  # inputs that stand at the start of a record
SHARED = Layout(constant=(), **OF_WORLD, mean_mass=1)
BODY = Layout(
    constant=(),
    **OF_BODY,
    wrench=6,
    start_pose=7, start_twist=6,  # at the beginning of the step, where the scheme works at its midpoint
    pose=7, twist=6,
    v=6,  # solution, in units of g h
    shift=6,  # displacement without velocity, in units of g h^2
    late=6,  # momentum that impacts give, times W - 1/2 (see `physid.physics.schemes.impact`)
    next_pose=7, next_twist=6,
    axes=9,  # body to world
    centre=3,  # of mass
    velocity=6,  # twist at the centre of mass
    world_inertia=6,  # xx xy xz yy yz zz, of the mean mass
    share=1,  # mass, of the mean mass
    free_momentum=6,  # what momentum would be if friction gave none before an impact
    momentum=6,  # p of eq. (3)
    free=6,  # velocity without contact
)  # fmt: skip
GIVEN = Layout(constant=(), **OF_BODY, wrench=6)  # what effects act on: the same inputs before them
GIVEN_SHARED = Layout(constant=(), **OF_WORLD)
EFFECTS = Layout(
    constant=("clock",),
    clock=1,  # time at which forces are taken [s]
    sizes=32,  # parameters of all effects, one after the other
)  # fmt: skip
PATCH = Layout(
    constant=("exists", "label", "choice", "hit", "reached"),
    frame=9,  # rows normal, tangent, tangent
    arm=12,  # from the centre of mass of the second body to each contact
    other_arm=12,  # the same of the first body
    gap=4, offset=4, friction=4, compliance=4,
    warp=4, lever=4,  # redundant modes
    tip=4,  # the lever of two bodies that stand
    flatness=1,
    slip=8,  # added to the tangential velocity that friction opposes, in units of g h
    share=1,  # W, which share of the step its impulses act
    hit=1,  # 1 if there is an impact, or 0
    reached=1,  # 1 if a contact closes in the step, or 0
    exists=4,
    label=4,  # names the corner that a contact is, from one step to the next
    choice=29,  # which corners, faces, edges: held fixed by the derivative
)  # fmt: skip
CONTACT = Layout(z=20, w=20, modes=2, r=20, dz=20, dw=20, dmodes=2, mode_force=2,
                 left=24, right=24, inner=4, label=4, fresh=4, impulse_bar=12, slides=4)  # fmt: skip
IMPULSE = Layout(total=12)
OUTCOME = Layout(worst=1)
MOTION = Layout(dv=6, force=6)
BLOCK = Layout(entries=36)
LANE = Layout(
    compliance=1,
    touches=1,  # 1 if there is a contact, or under `Midpoint` an impact
    active=1,  # 1 while the world takes Newton steps
    rung=1,  # which compliance is in use; -1 is the first again, from the previous solution
    count=1, worst=1, gap=1, target=1, length=1,
    numerator=1, denominator=1,  # of the longest step
    slope=1, curve=1,  # of the gap along a step
    restart=1, predicts=1, lost=1, solved=1,
    speed=1, distance=1,  # the largest that are at hand before the solution, in units of g h: what rounding goes by
    allowed=1, allowed_products=1,  # what errors are multiplied with before they are judged, those of products by both
    known=1,  # unit of velocities of the previous solution [m/s]; 0 if there is none
)  # fmt: skip
