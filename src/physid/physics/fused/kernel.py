"""The whole rollout, and its reverse derivative, as two functions of machine code."""

from __future__ import annotations

from physid.compiler.control import MOVES
from physid.compiler.section import Section
from physid.physics.fused import sections
from physid.physics.fused.formulas.layouts import BODY, EFFECTS
from physid.physics.fused.records import STATE, Shape
from physid.physics.fused.writer import INPUTS, SHARED_INPUTS, Writer


def write_forward(shape: Shape, name: str) -> str:
    """Write the rollout."""
    w = Writer(name, shape)
    code, n = w.code, shape.bodies
    rows = code.add(w.frames, 1)
    keeps = code.positive(code.argument("tape"))
    with code.loop("%first", "%last") as group:
        w.load_inputs(group)
        for problem in shape.problems:
            w.zero(f"lane{problem}")
        for k in range(n):
            w.zero(f"body{k}", "shift", 6)
        w.move_memory(group, save=False)
        begin, end = w.frames_of(group)
        for field, width in (("pose", 7), ("twist", 6)):
            w.body_rows("load_rows", ("body#", field), field, width, (begin, rows), group)
        with code.loop(begin, end) as frame:
            w.load_wrench(frame, group)
            w.zero("outcome")
            for p in range(shape.patches):
                w.zero(f"impulse{p}")
            with code.loop(0, w.substeps) as substep:
                w.pace(group, frame, substep)
                w.set_clock(group, frame, substep)
                _step(w, w.tape(group, frame, substep), keeps)
            for field, width in (("pose", 7), ("twist", 6)):
                w.body_rows("store_rows", ("body#", field), field, width, (code.add(frame, 1), rows), group)
            if shape.patches:
                w.frame_rows("store_rows", w.at("impulse0"), "impulse", 12 * shape.patches, (frame, w.frames), group)
            w.frame_rows("store_rows", w.at("outcome", "worst"), "residual", 1, (frame, w.frames), group)
            w.frame_rows("store_rows", w.at("lane", "count"), "newton_steps", 1, (frame, w.frames), group)
        w.move_memory(group, save=True)
    used = [*sections.assembly(shape), *sections.choices(shape), *sections.world_sections()]
    used += [*sections.moving_sections(shape), *sections.impact_sections(shape), sections.pace(shape)]
    used += [*sections.matrix_sections(n, transposed=False), *sections.outcome_sections()]
    for kind in sections.kinds(shape):
        used += [*sections.patch_sections(kind, slips=shape.midpoint), sections.eliminate(kind)]
    used += sections.lift_sections(adjoint=False) if shape.split else []
    return _module(w, used, [])


def _step(w: Writer, tape: str, keeps: str) -> None:
    """Write one step: assemble, solve, integrate."""
    code, shape = w.code, w.shape
    if shape.midpoint:
        for k in range(shape.bodies):
            code.call("copy", w.at(f"body{k}", "start_pose"), w.at(f"body{k}", "pose"), f"i64 {STATE}")
    w.act()
    if shape.midpoint:
        w.each_body("to_midpoint", "body#", "constants")
    w.assemble()
    with code.when(keeps):
        w.move_tape(tape, w.known_before(), 0, save=True)
    w.rescale()
    w.solve("")
    if shape.split:
        for k in range(shape.bodies):
            w.zero(f"body{k}", "shift", 6)
        with code.when(code.any(w.at("lane_lifted", "touches"))):
            w.solve("_lifted")
            w.each_body("settle", "lane_lifted", "body#_lifted", "body#")
    with code.when(keeps):
        w.move_tape(tape, w.solution(), STATE * shape.bodies, save=True)
    if shape.midpoint:
        w.gather_late()
        w.each_body("to_end", "body#", "shared", "constants")
    else:
        w.each_body("integrate", "body#", "constants")
    for k in range(shape.bodies):
        code.call("copy", w.at(f"body{k}", "pose"), w.at(f"body{k}", "next_pose"), f"i64 {STATE}")
    w.each_patch("collect_impulses", "contact*", "shared", "constants", "impulse*")


def write_backward(shape: Shape, name: str) -> str:
    """Write the reverse derivative of the rollout."""
    w = Writer(name, shape)
    code, n = w.code, shape.bodies
    rows = code.add(w.frames, 1)
    with code.loop("%first", "%last") as group:
        w.load_inputs(group)
        for record in ("shared_bar", "given_shared_bar", "effects_bar"):
            w.zero(record)
        for k in range(n):
            w.zero(f"body{k}_bar")
            w.zero(f"given{k}_bar")
            w.zero(f"body{k}", "shift", 6)
        for p in range(shape.patches):
            w.zero(f"impulse_bar{p}")
        with code.loop(0, w.frames) as reversed_frame:
            frame = code.emit(f"sub i64 {w.frames}, {code.add(reversed_frame, 1)}")
            _add_given(w, (code.add(frame, 1), rows), group)
            w.load_wrench(frame, group)
            if shape.patches:
                with code.when(code.positive(code.argument("impulse_bar"))):
                    place, width = w.at("impulse_bar0"), 12 * shape.patches
                    w.frame_rows("load_rows", place, "impulse_bar", width, (frame, w.frames), group)
            for k in range(n):
                w.zero(f"body{k}_bar", "wrench", 6)
                w.zero(f"given{k}_bar", "wrench", 6)
            with code.loop(0, w.substeps) as reversed_substep:
                substep = code.emit(f"sub i64 {w.substeps}, {code.add(reversed_substep, 1)}")
                w.pace(group, frame, substep)
                w.set_clock(group, frame, substep)
                w.move_tape(w.tape(group, frame, substep), w.known_before() + w.solution(), 0, save=False)
                _reverse_step(w)
            _take_given(w)
            w.body_rows("store_rows", ("body#_bar", "wrench"), "wrench_bar", 6, (frame, w.frames), group)
        _add_given(w, ("0", rows), group)
        w.body_rows("store_rows", ("body#_bar", "next_pose"), "first_pose_bar", 7, ("0", "1"), group)
        w.body_rows("store_rows", ("body#_bar", "next_twist"), "first_twist_bar", 6, ("0", "1"), group)
        w.body_rows("store_rows", ("body#_bar", "gravity"), "inputs_bar", INPUTS, ("0", "1"), group)
        w.frame_rows("store_rows", w.at("shared_bar"), "shared_bar", SHARED_INPUTS, ("0", "1"), group)
        with code.when(w.acts()):
            width = EFFECTS.widths["sizes"]
            w.rows("store_rows", w.at("effects_bar", "sizes"), code.argument("sizes_bar", "ptr"), width, width, group)
    return _module(w, *_backward_sections(shape))


def _backward_sections(shape: Shape) -> tuple[list[Section], list[Section]]:
    """Return the sections that are called as they are, and those of which the adjoint is called."""
    used = [
        *sections.assembly(shape),
        *sections.choices(shape),
        *sections.reverse_body_sections(midpoint=shape.midpoint),
        sections.pace(shape),
    ]
    used += sections.matrix_sections(shape.bodies, transposed=True)
    for kind in sections.kinds(shape):
        used += [*sections.reverse_sections(kind, midpoint=shape.midpoint), sections.eliminate(kind)]
    used += sections.lift_sections(adjoint=True) if shape.split else []
    used += [sections.TO_MIDPOINT, *sections.impact_sections(shape)] if shape.midpoint else []
    return used, [*sections.assembly(shape), *sections.moving_sections(shape), *sections.late_parts(shape)]


def _module(writer: Writer, used: list[Section], adjoints: list[Section]) -> str:
    texts = [section.forward() for section in used] + [section.adjoint() for section in adjoints]
    return "\n".join([MOVES, *texts, writer.code.text()])


def _add_given(w: Writer, at: tuple[str, str], group: str) -> None:
    """Add the given derivative by the states of a frame to what flows back from later ones."""
    for field, width in (("pose", 7), ("twist", 6)):
        with w.code.when(w.code.positive(w.code.argument(f"{field}_bar"))):
            w.body_rows("load_rows", ("body#_bar", field), f"{field}_bar", width, at, group)
            for k in range(w.shape.bodies):
                sum_, term = w.at(f"body{k}_bar", f"next_{field}"), w.at(f"body{k}_bar", field)
                w.code.call("add_to", sum_, term, f"i64 {width}")


def _take_given(w: Writer) -> None:
    """Take the derivative by what effects were given for that by the inputs, where there are effects."""
    with w.code.when(w.acts()):
        w.code.call("copy", w.at("shared_bar"), w.at("given_shared_bar"), f"i64 {SHARED_INPUTS}")
        for k in range(w.shape.bodies):
            w.code.call("copy", w.at(f"body{k}_bar"), w.at(f"given{k}_bar"), f"i64 {INPUTS + 6}")


def _reverse_step(w: Writer) -> None:
    """Write the reverse derivative of one step."""
    code, shape = w.code, w.shape
    w.act()
    with code.when(w.acts()):  # of this step alone: `effects_adjoint` adds up what was given
        w.zero("shared_bar")
        for k in range(shape.bodies):
            w.zero(f"body{k}_bar", slots=INPUTS + 6)
    if shape.midpoint:
        w.each_body("to_midpoint", "body#", "constants")
    w.assemble()
    if shape.split:
        w.each_body("settle", "lane_lifted", "body#_lifted", "body#")
    if shape.midpoint:
        w.gather_late()
    derived = BODY.offsets["axes"]
    for k in range(shape.bodies):
        w.zero(f"body{k}_bar", "pose", STATE + 12 + 6 * shape.midpoint)
        w.zero(f"body{k}_bar", "axes", BODY.slots - derived)
    for p in range(shape.patches):
        w.zero(f"patch{p}_bar")
    w.zero("shared_bar", "mean_mass", 1)
    if shape.midpoint:
        w.each_body("to_end_adjoint", "body#", "shared", "constants", "body#_bar", "shared_bar", "constants")
    else:
        w.each_body("integrate_adjoint", "body#", "constants", "body#_bar", "constants")
    w.each_patch("seed", "contact*", "impulse_bar*", "shared", "shared_bar", "constants")
    if shape.midpoint:
        with code.when(code.any(w.at("lane", "touches"))):
            _reverse_late(w)
    _reverse_solution(w, "")
    if shape.split:
        with code.when(code.any(w.at("lane_lifted", "touches"))):
            _reverse_lift(w)
    _reverse_assembly(w)
    if shape.midpoint:
        for k in range(shape.bodies):
            w.zero(f"body{k}_bar", "start_pose", STATE)
        w.each_body("to_midpoint_adjoint", "body#", "constants", "body#_bar", "constants")
    w.act("effects_adjoint")
    first = "start_pose" if shape.midpoint else "pose"
    for k in range(shape.bodies):
        code.call("copy", w.at(f"body{k}_bar", "next_pose"), w.at(f"body{k}_bar", first), f"i64 {STATE}")


def _reverse_late(w: Writer) -> None:
    """Write the derivative of what impacts move at once."""
    for p, touching in w.shape.touching:
        w.zero(f"pressed_bar{p}")
        records = f"patch{p}", f"contact{p}", "lane", f"pressed{p}", *(f"body{n}" for n in touching)
        bars = f"patch{p}_bar", f"contact{p}", "lane", f"pressed_bar{p}", *(f"body{n}_bar" for n in touching)
        w.call(f"late_part{len(touching)}_adjoint", *records, *bars)
    w.each_patch("add_impulse_bar", "contact*", "pressed_bar*")


def _reverse_solution(w: Writer, problem: str) -> None:
    """Write the derivative by what enters a contact problem, from that by its solution."""
    w.each_body("begin_reverse", f"body#{problem}_bar", "motion#")
    w.factorise(problem)
    w.by_patch("pull", problem, "motion#")
    w.substitute()
    w.by_patch("push", problem, f"patch*{problem}_bar", f"body#{problem}", "motion#")
    w.each_body("push_body", f"body#{problem}", f"body#{problem}_bar", "motion#")


def _reverse_lift(w: Writer) -> None:
    """Write the derivative of the removal of overlaps."""
    for k in range(w.shape.bodies):
        w.zero(f"body{k}_lifted_bar")
    for p in range(w.shape.patches):
        w.zero(f"patch{p}_lifted_bar")
        w.zero(f"contact{p}_lifted", "impulse_bar", 12)
    w.each_body("settle_adjoint", "lane_lifted", "body#_lifted_bar", "body#_bar")
    _reverse_solution(w, "_lifted")
    w.each_patch(
        "lift_patch_adjoint", "patch*", "constants", "patch*_lifted", "patch*_bar", "constants", "patch*_lifted_bar"
    )
    w.each_body("lift_body_adjoint", "body#", "body#_lifted", "body#_bar", "body#_lifted_bar")


def _reverse_assembly(w: Writer) -> None:
    shape = w.shape

    def call(section: str, *records: str) -> None:
        bars = [record if record == "constants" else f"{record}_bar" for record in records]
        w.call(f"{section}_adjoint", *records, *bars)

    for k, (a, b) in enumerate(shape.pairs):
        call("stand_boxes", "shared", f"patch{a}", f"patch{b}", f"patch{shape.grounds + k}")
    for n in range(shape.grounds):
        call("touch_ground", f"body{n}", "shared", "constants", f"patch{n}", *(f"patch{p}" for p in shape.beside(n)))
    for k, (a, b) in reversed(list(enumerate(shape.pairs))):
        call("touch_boxes", f"body{a}", f"body{b}", "shared", "constants", f"patch{shape.grounds + k}")
    for n in range(shape.bodies):
        call("prepare", f"body{n}", "shared", "constants")
    call("average_mass", "shared", *(f"body{n}" for n in range(shape.bodies)))
