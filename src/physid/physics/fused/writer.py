"""The calls of sections that make a step, written as LLVM code."""

from __future__ import annotations

from physid.compiler.control import Code
from physid.compiler.emit import LANES
from physid.physics.fused.formulas.layouts import CONSTANTS, EFFECTS, OF_BODY, OF_WORLD
from physid.physics.fused.records import CHOSEN, SOLVED, STATE, Shape

ARGUMENTS = (
    "worlds", "frames", "substeps", "begin", "end", "lengths", "steps", "steps_by_world", "constants", "tape", "memory",
    "inputs", "inputs_by_world", "shared", "shared_by_world", "wrench",
    "pose", "twist", "impulse", "residual", "newton_steps",
    "pose_bar", "twist_bar", "impulse_bar", "inputs_bar", "shared_bar", "wrench_bar", "first_pose_bar",
    "first_twist_bar", "effects", "effects_adjoint", "clock", "clock_by_world", "sizes", "sizes_by_world", "sizes_bar",
)  # fmt: skip
"""What a kernel is told: numbers, addresses, and distances [doubles] between worlds and between frames."""

INPUTS, SHARED_INPUTS = sum(OF_BODY.values()), sum(OF_WORLD.values())


class Writer:
    """Writes calls of sections on the records of a workspace."""

    def __init__(self, name: str, shape: Shape) -> None:
        self.shape, self.code = shape, Code(name, ARGUMENTS)
        self._at = {
            name: self.code.at("%workspace", slots * LANES)
            for name, (slots, _) in shape.records.items()
            if name != "end"
        }
        self.worlds, self.frames, self.substeps = (
            self.code.argument(name) for name in ("worlds", "frames", "substeps")
        )
        constants = self.code.argument("constants", "ptr")
        self.code.call("copy", self._at["constants"], constants, f"i64 {CONSTANTS.slots}")

    def at(self, record: str, field: str | None = None) -> str:
        """Return the address of a record, or of one of its fields."""
        offset = self.shape.records[record][1].offsets[field] if field else 0
        return self.code.at(self._at[record], offset * LANES) if offset else self._at[record]

    def call(self, section: str, *records: str) -> None:
        """Call a section on records."""
        self.code.call(section, *(self._at[record] for record in records))

    def pace(self, group: str, frame: str, substep: str) -> None:
        """Write the length of a step, where steps differ."""
        code = self.code
        with code.when(code.positive(code.argument("steps"))):
            place = code.at(code.argument("steps", "ptr"), code.add(code.multiply(frame, self.substeps), substep))
            self.rows("load_rows", self.at("constants", "step"), place, 1, code.argument("steps_by_world"), group)
            self.call("set_unit", "constants")

    def rescale(self) -> None:
        """Write the previous solution in the units of a step of another length."""
        with self.code.when(self.code.positive(self.code.argument("steps"))):
            self.each_body("rescale_body", "body#", "lane", "constants")
            self.each_patch("rescale", "contact*", "lane", "constants")

    def each_body(self, section: str, *names: str) -> None:
        """Call a section for every body; # in a name stands for its number."""
        for n in range(self.shape.bodies):
            self.call(section, *(name.replace("#", str(n)) for name in names))

    def each_patch(self, section: str, *names: str) -> None:
        """Call a section for every patch; * stands for its number."""
        for p in range(self.shape.patches):
            self.call(section, *(name.replace("*", str(p)) for name in names))

    def by_patch(self, section: str, problem: str, *names: str) -> None:
        """Call a section of the solver for every patch; names with # stand for a record of each of its bodies."""
        for p, touching in self.shape.touching:
            records = [f"patch{p}{problem}", f"contact{p}{problem}", f"lane{problem}"]
            for name in names:
                records += [name.replace("#", str(n)) for n in touching] if "#" in name else [name.replace("*", str(p))]
            self.call(f"{section}{len(touching)}", *records)

    def zero(self, record: str, field: str | None = None, slots: int | None = None) -> None:
        """Set a record, or so many slots from a field on, to zero."""
        slots = self.shape.records[record][1].slots if slots is None else slots
        self.code.call("zero", self.at(record, field), f"i64 {slots}")

    def assemble(self) -> None:
        """Write from the states to the contact problem."""
        shape = self.shape
        self.call("average_mass", "shared", *(f"body{n}" for n in range(shape.bodies)))
        self.each_body("prepare", "body#", "shared", "constants")
        for k, (a, b) in enumerate(shape.pairs):
            patch = f"patch{shape.grounds + k}"
            self.call("choose_axis", f"body{a}", f"body{b}", patch)
            self.call("choose_points", f"body{a}", f"body{b}", patch)
            self.call("touch_boxes", f"body{a}", f"body{b}", "shared", "constants", patch)
        for n in range(shape.grounds):
            self.call("choose_corners", f"body{n}", "shared", f"patch{n}")
            beside = [f"patch{p}" for p in shape.beside(n)]
            self.call("touch_ground", f"body{n}", "shared", "constants", f"patch{n}", *beside)
        for k, (a, b) in enumerate(shape.pairs):
            self.call("stand_boxes", "shared", f"patch{a}", f"patch{b}", f"patch{shape.grounds + k}")
        if shape.midpoint:
            self.code.call("zero", self.at("lane", "touches"), "i64 1")
            self.each_patch("note_impact", "patch*", "lane")
        if shape.split:
            self.code.call("zero", self.at("lane_lifted", "touches"), "i64 1")
            self.each_patch("measure", "patch*", "lane_lifted")
            self.each_patch("lift_patch", "patch*", "constants", "patch*_lifted")
            self.each_body("lift_body", "body#", "body#_lifted")

    def gather_late(self) -> None:
        """Write what impacts move at once, from the solution."""
        for n in range(self.shape.bodies):
            self.zero(f"body{n}", "late", 6)
        with self.code.when(self.code.any(self.at("lane", "touches"))):
            self.each_patch("read_impulses", "contact*", "pressed*")
            for p, touching in self.shape.touching:
                records = f"patch{p}", f"contact{p}", "lane", f"pressed{p}", *(f"body{n}" for n in touching)
                self.call(f"add_late{len(touching)}", *records)

    def factorise(self, problem: str) -> None:
        """Write the Newton matrix and its factors."""
        n = self.shape.bodies
        self.zero("block00", slots=36 * n * n)
        for k in range(n):
            self.call("fill", f"body{k}{problem}", f"block{k}{k}")
        for p, touching in self.shape.touching:
            blocks = [f"block{i}{j}" for i in touching for j in touching]
            records = f"patch{p}{problem}", f"contact{p}{problem}", f"lane{problem}"
            self.call(f"eliminate{len(touching)}", *records, *blocks)
        self.call("factor", "block00")

    def substitute(self) -> None:
        """Write the solution of the Newton equations of the bodies."""
        self.call("solve", "block00", *(f"motion{n}" for n in range(self.shape.bodies)))

    def evaluate(self, problem: str) -> None:
        """Write the errors of all equations."""
        self.call("clear", f"lane{problem}")
        self.each_body("evaluate_body", f"body#{problem}", "motion#")
        self.by_patch("evaluate", problem, "constants", f"body#{problem}", "motion#")
        self.each_body("judge", "motion#", f"lane{problem}")

    def direction(self, problem: str) -> None:
        """Write the Newton direction."""
        self.each_body("begin_direction", "motion#")
        self.by_patch("gather", problem, "motion#")
        self.substitute()
        self.by_patch("expand", problem, "motion#")

    def restart(self, problem: str) -> None:
        """Write the start of the worlds that are told to."""
        self.each_body("start_body", f"body#{problem}", f"lane{problem}")
        self.by_patch("start", problem, f"body#{problem}")
        self.evaluate(problem)

    def solve(self, problem: str) -> None:
        """Write the solver: Newton steps until every world is done."""
        code, lane = self.code, f"lane{problem}"
        self.call("begin", lane, "constants")
        self.each_body("gauge", f"body#{problem}", lane)
        self.each_patch("recall", f"patch*{problem}", f"contact*{problem}", lane)
        self.call("allow", lane, "constants")
        self.restart(problem)
        with code.repeat() as loop:
            self.call("check", lane, "constants")
            code.leave(loop, code.any(self.at(lane, "active")))
            with code.when(code.any(self.at(lane, "restart"))):
                self.restart(problem)
            self.factorise(problem)
            self.call("aim_at_end", lane, "constants")
            with code.when(code.any(self.at(lane, "predicts"))):
                self.call("aim_at_zero", lane, "constants")
                self.direction(problem)
                self.call("aim", lane, "constants")
            self.direction(problem)
            self.call("decide_length", lane)
            self.each_body("move_body", f"body#{problem}", "motion#", lane)
            self.each_patch("move", f"contact*{problem}", lane)
            self.evaluate(problem)
        self.call("report", lane, "outcome")

    def frames_of(self, group: str) -> tuple[str, str]:
        """Return the first frame to step from, and the one to stop at: the last that a world of the group needs."""
        code = self.code
        begin, end = (code.argument(name) for name in ("begin", "end"))
        place = code.emit(f"getelementptr i64, ptr {code.argument('lengths', 'ptr')}, i64 {group}")
        needed = code.emit(f"load i64, ptr {place}")
        sooner = code.emit(f"icmp slt i64 {needed}, {end}")
        return begin, code.emit(f"select i1 {sooner}, i64 {needed}, i64 {end}")

    def known_before(self) -> list[tuple[str, int]]:
        """Return what a tape keeps of a step before its solution: address and slots."""
        field = "start_pose" if self.shape.midpoint else "pose"
        return [(self.at(f"body{n}", field), STATE) for n in range(self.shape.bodies)]

    def solution(self) -> list[tuple[str, int]]:
        """Return what a tape keeps of the solution of a step: address and slots."""
        parts = []
        for problem in self.shape.problems:
            parts += [(self.at(f"body{n}{problem}", "v"), 6) for n in range(self.shape.bodies)]
            parts += [(self.at(f"contact{p}{problem}", "z"), SOLVED) for p in range(self.shape.patches)]
            parts.append((self.at(f"lane{problem}", "compliance"), CHOSEN))
        return parts

    def remembered(self) -> list[tuple[str, int]]:
        """Return from what the next step starts: address and slots."""
        parts = []
        for problem in self.shape.problems:
            parts += [(self.at(f"body{n}{problem}", "v"), 6) for n in range(self.shape.bodies)]
            for p in range(self.shape.patches):
                parts.append((self.at(f"contact{p}{problem}", "z"), SOLVED))
                parts.append((self.at(f"contact{p}{problem}", "label"), 4))
            parts.append((self.at(f"lane{problem}", "known"), 1))
        return parts

    def move_memory(self, group: str, *, save: bool) -> None:
        """Copy what the next step starts from to or from the memory, if there is one."""
        code = self.code
        with code.when(code.positive(code.argument("memory"))):
            place = code.multiply(group, self.shape.memory * LANES)
            self.move_tape(code.at(code.argument("memory", "ptr"), place), self.remembered(), 0, save=save)

    def tape(self, group: str, frame: str, substep: str) -> str:
        """Return the address of what is kept of a step."""
        code = self.code
        step = code.add(code.multiply(frame, self.substeps), substep)
        place = code.add(code.multiply(group, code.multiply(self.frames, self.substeps)), step)
        return code.at(code.argument("tape", "ptr"), code.multiply(place, self.shape.tape * LANES))

    def move_tape(self, tape: str, parts: list[tuple[str, int]], slot: int, *, save: bool) -> None:
        """Copy parts of the workspace to or from a tape, from a slot on."""
        for place, slots in parts:
            here = self.code.at(tape, slot * LANES)
            self.code.call("copy", *((here, place) if save else (place, here)), f"i64 {slots}")
            slot += slots

    def rows(self, move: str, place: str, base: str, width: int, by_world: str | int, group: str) -> None:
        """Load or store so many slots of the worlds of a group, from arrays with a row per world."""
        pair = (place, base) if move == "load_rows" else (base, place)
        first = self.code.multiply(group, LANES)
        self.code.call(move, *pair, f"i64 {width}", f"i64 {by_world}", f"i64 {first}", f"i64 {self.worlds}")

    def frame_rows(self, move: str, place: str, argument: str, width: int, at: tuple[str, str], group: str) -> None:
        """Load or store one frame of an array (worlds, count, width), for `at` = (frame, count)."""
        frame, count = at
        base = self.code.at(self.code.argument(argument, "ptr"), self.code.multiply(frame, width))
        self.rows(move, place, base, width, self.code.multiply(count, width), group)

    def body_rows(
        self, move: str, names: tuple[str, str], argument: str, width: int, at: tuple[str, str], group: str
    ) -> None:
        """Do the same for an array (worlds, count, bodies, width) and a field of every body, names (record, field)."""
        code, (frame, count), total = self.code, at, width * self.shape.bodies
        base = code.at(code.argument(argument, "ptr"), code.multiply(frame, total))
        by_world = code.multiply(count, total)
        for n in range(self.shape.bodies):
            place = self.at(names[0].replace("#", str(n)), names[1])
            self.rows(move, place, code.at(base, n * width), width, by_world, group)

    def load_inputs(self, group: str) -> None:
        """Load what enters steps beside state and wrench, and the parameters of the effects that act on it."""
        code = self.code
        self._load_inputs(group, "body#", "shared")
        with code.when(self.acts()):
            self._load_inputs(group, "given#", "given_shared")
            place, base = self.at("effects", "sizes"), code.argument("sizes", "ptr")
            self.rows("load_rows", place, base, EFFECTS.widths["sizes"], code.argument("sizes_by_world"), group)

    def load_wrench(self, frame: str, group: str) -> None:
        """Load the wrenches of a frame, and those that effects are given."""
        self.body_rows("load_rows", ("body#", "wrench"), "wrench", 6, (frame, self.frames), group)
        with self.code.when(self.acts()):
            self.body_rows("load_rows", ("given#", "wrench"), "wrench", 6, (frame, self.frames), group)

    def acts(self) -> str:
        """Return whether there are effects that act on steps."""
        return self.code.positive(self.code.argument("effects"))

    def set_clock(self, group: str, frame: str, substep: str) -> None:
        """Load the time at which effects act."""
        code = self.code
        with code.when(self.acts()):
            base = code.at(code.argument("clock", "ptr"), code.add(code.multiply(frame, self.substeps), substep))
            self.rows("load_rows", self.at("effects", "clock"), base, 1, code.argument("clock_by_world"), group)

    def act(self, what: str = "effects") -> None:
        """Let effects make the inputs of a step, or add the derivative of that, where there are any."""
        with self.code.when(self.acts()):
            self.code.lines.append(f"  call void {self.code.argument(what, 'ptr')}(ptr %workspace)")

    def _load_inputs(self, group: str, of_body: str, of_world: str) -> None:
        code, bodies = self.code, [of_body.replace("#", str(n)) for n in range(self.shape.bodies)]
        for name, width, records in (("inputs", INPUTS, bodies), ("shared", SHARED_INPUTS, [of_world])):
            base, by_world = code.argument(name, "ptr"), code.argument(f"{name}_by_world")
            for k, record in enumerate(records):
                self.rows("load_rows", self.at(record), code.at(base, k * width), width, by_world, group)
