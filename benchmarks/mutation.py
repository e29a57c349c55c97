"""Change the code in one place and see whether a test fails: tests that cannot fail are no tests.

    python benchmarks/mutation.py                                    12 changes of each module
    python benchmarks/mutation.py --count 40 --minutes 30 --kept runs/mutation.jsonl     added to an earlier call

A change turns a comparison, an operation, a number, a truth value, a sign, a minimum or a choice into another one.
They are drawn at random from all that can be made of a module (checks that change no value apart: assertions, raised
errors, zip's `strict`), and the tests of that module run against each in a process that has imported what takes long:
the quick ones, and if those pass the slow ones, which run before each landing. A change *survives* if all of them pass;
a test that runs for much longer than with the code as it is has failed too. Survivors are printed: each is a missing
test, or changes nothing. Modules come in random order, so that a call that --minutes cuts
short has still sampled all of them.

No known tool fits: mutmut 3 copies the tree and wants the whole suite to pass there first, cosmic-ray starts Python and
imports torch for each change.
"""

from __future__ import annotations

import argparse
import ast
import copy
import hashlib
import importlib
import json
import math
import os
import random
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib.machinery import SourceFileLoader
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
SOURCE, TESTS = ROOT / "src" / "physid", ROOT / "tests"
SUITES: dict[str, tuple[str, ...]] = {
    "physics/rotations.py": ("physics/test_rotations.py",),
    "physics/joints.py": ("physics/test_joints.py",),
    "physics/contact.py": (
        *("physics/test_contact_rules.py", "physics/test_patches.py", "physics/test_collision.py"),
        "physics/test_compiled_contacts.py",
    ),
    "physics/contact_problem/lcp.py": (
        *("physics/test_solver_laws.py", "physics/test_compiled_steps.py", "physics/test_lcp.py"),
    ),
    "physics/contact_problem/[!l]*.py": (
        *("physics/test_solver_laws.py", "physics/test_compiled_contacts.py", "physics/test_compiled_solver.py"),
        *("physics/test_compiled_steps.py", "physics/test_lcp.py", "physics/test_cones.py"),
    ),
    "physics/schemes/*.py": (
        *("physics/test_motion_laws.py", "physics/test_impact_laws.py", "physics/test_compiled_schemes.py"),
        *("physics/test_compiled_steps.py", "physics/test_grid.py"),
    ),
    "physics/shapes/*.py": (
        *("physics/test_nearest_points.py", "physics/test_collision.py", "physics/test_compiled_contacts.py"),
        "physics/test_shapes.py",
    ),
    "physics/state.py physics/parameters.py physics/world.py physics/effect.py physics/layer.py": (
        *("physics/test_inputs.py", "physics/test_layer.py", "physics/test_border.py", "physics/test_lengths.py"),
        "effects/test_catalogue.py",
    ),
    "physics/step.py": ("physics/test_compiled_steps.py", "physics/test_shapes.py"),
    "physics/fused/formulas/*.py physics/fused/formulas/*/*.py": (
        *("physics/test_compiled_contacts.py", "physics/test_compiled_solver.py", "physics/test_compiled_lanes.py"),
        *("physics/test_compiled_schemes.py", "physics/test_compiled_steps.py", "physics/test_fused_compiler.py"),
    ),
    "physics/case.py physics/reference.py physics/compiled.py physics/guards/*.py": (
        *("physics/test_inputs.py", "physics/test_border.py", "physics/test_made_once.py", "physics/test_compiled.py"),
        *("physics/test_layer.py", "physics/test_grid.py"),
    ),
    "physics/fused/*.py": (
        *("physics/test_compiled_steps.py", "physics/test_lengths.py", "physics/test_compiled_effects.py"),
        *("physics/test_grid.py", "physics/test_fused.py"),
    ),
    "effects/actuation/*.py": ("effects/test_actuation.py", "effects/test_catalogue.py"),
    "effects/contact/*.py": ("effects/test_contact.py", "effects/test_catalogue.py"),
    "effects/dynamics/*.py": ("effects/test_dynamics.py", "effects/test_catalogue.py"),
    "effects/perception/*.py": (
        *("effects/test_perception.py", "effects/test_filtering.py", "effects/test_catalogue.py"),
    ),
    "effects/filtering.py": ("effects/test_filtering.py",),
    "effects/laws.py effects/loading.py effects/probe.py effects/table.py": (
        *("effects/test_loading.py", "effects/test_catalogue.py", "effects/test_engines_agree.py"),
    ),
    "effects/motion.py": ("diagnosis/test_effect_file.py", "diagnosis/test_law_parts.py"),
    "effects/resampling.py": ("effects/test_perception.py", "effects/test_actuation.py"),
    "effects/touch.py": ("effects/test_contact.py", "physics/test_shapes.py"),
    "estimation/prediction/timeline.py": ("diagnosis/test_timeline.py", "estimation/test_cuts.py"),
    "estimation/prediction/segments.py": ("diagnosis/test_segments.py", "estimation/test_cuts.py"),
    "estimation/prediction/step_effects.py": ("diagnosis/test_step_effects.py",),
    "estimation/prediction/coordinates.py": (
        *("training/test_physical_parameters.py", "diagnosis/test_equivalence.py", "estimation/test_starts.py"),
    ),
    "estimation/prediction/variants.py estimation/prediction/nominal_model.py estimation/prediction/effect_*.py": (
        *("estimation/test_nominal_model.py", "estimation/test_effects_at_work.py", "estimation/test_cuts.py"),
    ),
    "estimation/prediction/rollout.py estimation/prediction/candidates.py": (
        *("diagnosis/test_timeline.py", "diagnosis/test_prediction.py", "estimation/test_cuts.py"),
        *("estimation/test_effects_at_work.py", "estimation/test_two_bodies.py", "estimation/test_variants.py"),
    ),
    "estimation/measurement/sensor_noise.py estimation/measurement/outliers.py estimation/measurement/poses.py": (
        *("diagnosis/test_noise.py", "estimation/test_errors_of_poses.py", "estimation/test_frame_weights.py"),
        *("estimation/test_moved_poses.py", "estimation/test_outliers.py"),
    ),
    "estimation/measurement/misfit.py estimation/measurement/unexplained.py estimation/measurement/tracking_error.py": (
        *("training/test_unexplained.py", "diagnosis/test_tracking_error.py", "estimation/test_errors_of_poses.py"),
    ),
    "estimation/measurement/correlat*.py": ("estimation/test_correlated_noise.py",),
    "estimation/measurement/deviation.py": (
        *("estimation/test_correlated_noise.py", "estimation/test_errors_of_poses.py", "diagnosis/test_noise.py"),
    ),
    "estimation/measurement/force_noise.py": ("estimation/test_force_noise.py",),
    "estimation/prediction/seams.py": ("estimation/test_seams.py",),
    "estimation/segmented_fit/unexplained.py": ("estimation/test_unexplained_events.py",),
    "estimation/segmented_fit/odd_trajectories.py": ("estimation/test_odd_trajectories.py",),
    "estimation/least_squares/multi_start.py": (
        *("diagnosis/test_multi_start.py", "estimation/test_starts.py", "estimation/test_steps_taken.py"),
    ),
    "estimation/least_squares/initial_states.py": (
        *("diagnosis/test_initial_states.py", "estimation/test_starts.py", "estimation/test_unseen_frames.py"),
        "estimation/test_parallel_bodies.py",
    ),
    "estimation/least_squares/experiment.py estimation/least_squares/prior.py estimation/least_squares/first_*.py": (
        *("estimation/test_fits.py", "estimation/test_directions.py", "estimation/test_steps_taken.py"),
        *("estimation/test_starts.py", "estimation/test_nominal_model.py", "diagnosis/test_multi_start.py"),
    ),
    "estimation/least_squares/normal_equations.py": (
        *("diagnosis/test_normal_equations.py", "diagnosis/test_residual_wrench.py", "diagnosis/test_score_test.py"),
        *("diagnosis/test_equivalence.py", "diagnosis/test_hypothesis.py", "training/test_intervals.py"),
        "estimation/test_directions.py",
    ),
    "estimation/least_squares/jacobian.py": (
        *("diagnosis/test_slopes.py", "diagnosis/test_initial_states.py", "diagnosis/test_equivalence.py"),
        *("training/test_identifiability.py", "estimation/test_directions.py", "estimation/test_steps_taken.py"),
        "estimation/test_parallel_bodies.py",
    ),
    "estimation/least_squares/covariance.py": (
        *("training/test_intervals.py", "diagnosis/test_hypothesis.py", "estimation/test_scatter.py"),
    ),
    "estimation/least_squares/discretisation.py": ("training/test_step_choice.py", "estimation/test_late_forces.py"),
    "estimation/least_squares/levenberg_marquardt.py estimation/least_squares/line_search.py": (
        *("training/test_intervals.py", "diagnosis/test_nominal_fit.py", "training/test_optimizers.py"),
        *("estimation/test_fits.py", "estimation/test_starts.py", "estimation/test_steps_taken.py"),
    ),
    "estimation/segmented_fit/events.py": (
        *("diagnosis/test_noise.py", "diagnosis/test_inputs.py", "estimation/test_events.py"),
    ),
    "estimation/segmented_fit/motion_phases.py": ("diagnosis/test_motion_phases.py", "estimation/test_phases.py"),
    "estimation/segmented_fit/fit.py estimation/segmented_fit/observed.py estimation/segmented_fit/weights.py": (
        *("estimation/test_segmented_fit.py", "estimation/test_agreement.py", "estimation/test_fit_around_events.py"),
    ),
    "diagnosis/inputs/model_source.py": ("diagnosis/test_inputs.py", "diagnosis/test_model_source.py"),
    "diagnosis/inputs/requirements.py": ("diagnosis/test_requirements.py",),
    "diagnosis/inputs/inputs.py diagnosis/inputs/observations.py": (
        *("diagnosis/test_roles.py", "diagnosis/test_requirements.py", "diagnosis/test_from_video.py"),
    ),
    "diagnosis/reference/nominal_fit.py diagnosis/reference/following.py": (
        *("diagnosis/test_flights_fitted.py", "diagnosis/test_nominal_fit.py"),
    ),
    "diagnosis/reference/discrepancy.py": (
        *("diagnosis/test_flights_fitted.py", "diagnosis/test_discrepancy.py", "diagnosis/test_lying.py"),
    ),
    "diagnosis/reference/numerics.py": ("diagnosis/test_flights_fitted.py", "diagnosis/test_numerics.py"),
    "diagnosis/reference/*stored_fit.py diagnosis/reference/*cache.py diagnosis/reference/fit_findings.py": (
        *("diagnosis/test_stored_fit.py", "training/test_fit_findings.py"),
    ),
    "diagnosis/reference/replay.py": (
        "diagnosis/test_replay.py",
        "diagnosis/test_lying.py",
        "diagnosis/test_inputs.py",
        "diagnosis/test_diagnose.py",
    ),
    "diagnosis/reference/null_simulations.py": (
        *("diagnosis/test_null_simulations.py", "diagnosis/test_score_test.py", "diagnosis/test_diagnose.py"),
    ),
    "diagnosis/testing/score_test.py": (
        "diagnosis/test_score_test.py",
        "diagnosis/test_power.py",
        "diagnosis/test_inputs.py",
    ),
    "diagnosis/testing/null_*.py": (
        *("diagnosis/test_null_tails.py", "diagnosis/test_score_test.py", "diagnosis/test_flights_examined.py"),
    ),
    "diagnosis/testing/equivalence.py": (
        *("diagnosis/test_equivalence.py", "diagnosis/test_flights_examined.py", "diagnosis/test_diagnose.py"),
    ),
    "diagnosis/testing/residual_wrench.py": (
        *("diagnosis/test_residual_wrench.py", "diagnosis/test_gap.py", "diagnosis/test_flights_examined.py"),
    ),
    "diagnosis/testing/lack_of_fit.py diagnosis/testing/examination.py": (
        *("diagnosis/test_localisation.py", "diagnosis/test_verdict.py", "diagnosis/test_flights_examined.py"),
        "diagnosis/test_diagnose.py",
    ),
    "diagnosis/residual_law/*.py": ("diagnosis/test_law_parts.py", "diagnosis/test_residual_law.py"),
    "diagnosis/testing/hypothesis.py": (
        *("diagnosis/test_flights_searched.py", "diagnosis/test_hypothesis.py", "diagnosis/test_finite_sizes.py"),
    ),
    "diagnosis/selection/*.py": (
        *("diagnosis/test_verdict.py", "diagnosis/test_attribution.py", "diagnosis/test_contact_free.py"),
        *("diagnosis/test_materiality.py", "diagnosis/test_regained.py", "diagnosis/test_given_parameters.py"),
        *("diagnosis/test_flights_searched.py", "diagnosis/test_diagnose.py"),
    ),
    "diagnosis/posterior/*.py": ("diagnosis/test_posterior.py", "diagnosis/test_answers.py"),
    "diagnosis/conclusion/verdict.py": ("diagnosis/test_verdict.py", "diagnosis/test_answers.py"),
    "diagnosis/conclusion/localisation.py": ("diagnosis/test_localisation.py", "diagnosis/test_answers.py"),
    "diagnosis/conclusion/gap.py": ("diagnosis/test_gap.py", "diagnosis/test_verdict.py", "diagnosis/test_answers.py"),
    "diagnosis/conclusion/power.py": ("diagnosis/test_power.py", "diagnosis/test_answers.py"),
    "diagnosis/conclusion/decomposition.py": ("diagnosis/test_decomposition.py", "diagnosis/test_answers.py"),
    "diagnosis/conclusion/closings.py": (
        *("diagnosis/test_closings.py", "diagnosis/test_decomposition.py", "diagnosis/test_flights_concluded.py"),
    ),
    "diagnosis/conclusion/conclusion.py diagnosis/conclusion/judgement.py": (
        *("diagnosis/test_flights_concluded.py", "diagnosis/test_closings.py", "diagnosis/test_materiality.py"),
    ),
    "diagnosis/conclusion/description.py diagnosis/conclusion/estimates.py diagnosis/fitted_model.py": (
        *("diagnosis/test_flights_concluded.py", "diagnosis/test_closings.py"),
    ),
    "diagnosis/analysis.py": ("diagnosis/test_stored_fit.py", "diagnosis/test_given_parameters.py"),
    "diagnosis/conclusion/next_experiment.py": ("diagnosis/test_next_experiment.py",),
    "diagnosis/conclusion/where.py": ("diagnosis/test_localisation.py", "diagnosis/test_flights_concluded.py"),
    "diagnosis/testing/parametric_bootstrap.py": (
        *("diagnosis/test_parametric_bootstrap.py", "diagnosis/test_flights_searched.py"),
    ),
    "diagnosis/document/errors.py diagnosis/document/evidence.py diagnosis/document/residual_law.py": (
        *("diagnosis/test_document.py", "diagnosis/test_figures.py", "diagnosis/test_posterior.py"),
        "diagnosis/test_answers.py",
    ),
    "diagnosis/document/document.py diagnosis/settings/settings.py": (
        *("diagnosis/test_document.py", "diagnosis/test_settings.py", "diagnosis/test_answers.py"),
        *("diagnosis/test_words.py", "diagnosis/test_sentences.py"),
    ),
    "diagnosis/document/effect_file.py": ("diagnosis/test_effect_file.py",),
    "diagnosis/document/flat_figures.py diagnosis/document/rounding.py": (
        *("diagnosis/test_figures.py", "diagnosis/test_sentences.py"),
    ),
    "diagnosis/document/residual_sentences.py": ("diagnosis/test_words.py", "diagnosis/test_residual_law.py"),
    "diagnosis/document/sentences.py": (
        *("diagnosis/test_words.py", "diagnosis/test_sentences.py", "diagnosis/test_document.py"),
    ),
}
"""The tests of each module, or of all that match one of several patterns."""
SLOW = (
    *("h5py", "joblib", "jsonargparse", "lightning", "matplotlib.pyplot", "mujoco", "omegaconf", "pybullet"),
    *("pydantic", "scipy.optimize", "scipy.stats", "torch", "tqdm", "yaml"),
)
"""What is imported before, once for all; pytest itself must still see hypothesis come."""
QUICK, SLOW_ONES = "not slow", "slow"
NONE_MARKED = 5  # what pytest returns where no test has the mark
FACTOR, LEAST, LONGEST, WAITING = 8.0, 20.0, 1800.0, 20.0
"""A run of the tests that computes this many times as long as usual, and at least so long [s], counts as failed; so
does one that takes the last times its limit by the clock. Without a change the tests may compute for the third [s]."""
OPERATORS: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.MatMult: ast.Mult,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
NAMES = {
    "min": "max", "max": "min", "amin": "amax", "amax": "amin", "argmin": "argmax", "argmax": "argmin", "any": "all",
    "all": "any", "minimum": "maximum", "maximum": "minimum", "sin": "cos", "cos": "sin", "sum": "mean", "mean": "sum",
    "zeros_like": "ones_like", "ones_like": "zeros_like", "clamp_min": "clamp_max", "clamp_max": "clamp_min",
}  # fmt: skip


def places(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes that can be changed: no annotations, no decorators, no units or bounds of fields, no checks."""
    if isinstance(tree, ast.AnnAssign):
        children: list[Any] = [] if isinstance(tree.value, ast.Call) or tree.value is None else [tree.value]
    elif isinstance(tree, ast.FunctionDef):
        children = [*tree.args.defaults, *tree.args.kw_defaults, *tree.body]
    elif isinstance(tree, ast.ClassDef):
        children = tree.body
    else:
        children = list(ast.iter_child_nodes(tree))
    if isinstance(tree, ast.keyword) and tree.arg == "strict":  # of zip: like an assertion, it changes no value
        return
    if not isinstance(tree, ast.Raise | ast.Assert | ast.Import | ast.ImportFrom):  # messages have tests of their own
        if changed(tree) is not None:
            yield tree
        for each in children:
            if each is not None:
                yield from places(each)


def changed(node: ast.AST) -> ast.AST | None:
    """Return what a node becomes, or None if nothing is made of it."""
    new: Any = copy.copy(node)
    match node:
        case ast.BinOp(op=old) | ast.BoolOp(op=old) | ast.AugAssign(op=old) if type(old) in OPERATORS:
            new.op = OPERATORS[type(old)]()
        case ast.Compare(ops=[old, *others]):
            new.ops = [OPERATORS[type(old)](), *others]
        case ast.UnaryOp(op=ast.USub() | ast.Not()):
            new = node.operand
        case ast.Constant(value=bool(value)):
            new.value = not value
        case ast.Constant(value=int(value) | float(value)):
            new.value = value + 1
        case ast.Attribute(attr=name) if name in NAMES:
            new.attr = NAMES[name]
        case ast.Call(func=ast.Name(id=name)) if name in NAMES and name not in ("sum", "mean"):
            new.func = ast.Name(NAMES[name], ast.Load())
        case ast.IfExp():
            new.body, new.orelse = node.orelse, node.body
        case _:
            return None
    return ast.copy_location(new, node)


def mutant(text: str, number: int) -> tuple[str, str]:
    """Return the source with one change, and the change in words."""
    tree = ast.parse(text)
    old = list(places(tree))[number]
    new = changed(old)
    before = f"{old.lineno}: {ast.unparse(old)}"  # type: ignore[attr-defined]

    class Put(ast.NodeTransformer):
        def visit(self, node: ast.AST) -> Any:
            return new if node is old else self.generic_visit(node)

    after = ast.unparse(Put().visit(tree))
    return after, f"{before} -> {ast.unparse(new)}"  # type: ignore[arg-type]


def survives(module: Path, source: str | None, suite: tuple[str, ...], marked: str, limit: float) -> tuple[bool, float]:
    """Run a module's tests against a changed source in a process of its own; returns also the time [s] it computed.

    The limit [s] is one of computing, so that what else the machine does plays no part; a multiple of it is one of the
    clock.
    """
    start = time.monotonic()
    process = os.fork()
    if not process:
        os.setpgrp()
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(limit), math.ceil(limit) + 1))
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.dup2(null, 2)
        os._exit(_tested(module, source, suite, marked))
    while time.monotonic() - start < WAITING * limit:
        done, code, used = os.wait4(process, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(code) in (0, NONE_MARKED), used.ru_utime + used.ru_stime
        time.sleep(0.05)
    os.killpg(process, signal.SIGKILL)
    os.waitpid(process, 0)
    return False, limit


def _tested(module: Path, source: str | None, suite: tuple[str, ...], marked: str) -> int:
    import pytest

    usual = SourceFileLoader.get_code

    def get_code(self: SourceFileLoader, name: str) -> Any:
        if source is not None and Path(self.path) == module:
            return compile(source, self.path, "exec")
        return usual(self, name)

    SourceFileLoader.get_code = get_code  # type: ignore[method-assign]
    _keep_machine_code_by_its_text()
    # Pytest would load what it takes for tests, such as score_test.py, past this, to rewrite their asserts.
    words = ["-x", "-q", "-p", "no:cacheprovider", "-m", marked, "--assert=plain"]
    return int(pytest.main([*words, *(str(TESTS / each) for each in suite)]))


def _keep_machine_code_by_its_text() -> None:
    """Let changed formulas be compiled: the files of sources, by which machine code is kept, have not changed."""
    from physid.compiler import machine

    usual, place = machine.address, machine._place

    def address(name: str, write: Callable[[], str]) -> int:
        text = write()
        digest = hashlib.sha256(text.encode()).hexdigest()[:16]
        machine._place = lambda name: place(name).with_suffix(f".{digest}")
        return usual(name, lambda: text)

    machine.address = address


def drawn(pattern: str, count: int, seed: int) -> list[tuple[Path, int]]:
    """Return modules and numbers of changes, drawn at random from all of a pattern."""
    found = {path for each in pattern.split() for path in SOURCE.glob(each)}
    modules = [path for path in sorted(found) if path.name != "__init__.py"]
    every = [(path, number) for path in modules for number in range(len(list(places(ast.parse(path.read_text())))))]
    return random.Random(f"{seed} {pattern}").sample(every, min(count, len(every)))


def main() -> None:
    """Print the survivors, and a row for each module: changes, how many of them a test has noticed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=12, help="changes of each module")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--modules", default="", help="only those whose names contain this")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no further change after this time")
    parser.add_argument("--quick", action="store_true", help="leave the slow tests out")
    parser.add_argument("--kept", type=Path, help="file of what was tried; what survived is tried again")
    chosen = parser.parse_args()
    os.chdir(ROOT)
    sys.path[:0] = [str(ROOT), str(TESTS)]
    for slow in SLOW:
        importlib.import_module(slow)
    cache = tempfile.TemporaryDirectory()
    os.environ["XDG_CACHE_HOME"] = cache.name
    rows: dict[str, dict[str, Any]] = {}
    if chosen.kept and chosen.kept.is_file():
        rows = {row["change"]: row for row in map(json.loads, chosen.kept.read_text().splitlines())}
    again = {change for change, row in rows.items() if row["survived"]}
    begun, usual = time.monotonic(), dict[tuple[tuple[str, ...], str], float]()
    wanted = {pattern: suite for pattern, suite in SUITES.items() if chosen.modules in pattern}
    wanted = dict(random.Random(chosen.seed).sample(list(wanted.items()), len(wanted)))
    lists = {pattern: drawn(pattern, chosen.count, chosen.seed) for pattern in wanted}
    for turn in range(chosen.count):
        for pattern, suite in wanted.items():
            if turn >= len(lists[pattern]) or time.monotonic() - begun > 60 * chosen.minutes:
                continue
            module, number = lists[pattern][turn]
            source, words = mutant(module.read_text(), number)
            change = f"{module.relative_to(SOURCE)}:{words}"
            if change in rows and change not in again:
                continue
            survived = {QUICK: True, SLOW_ONES: True}
            for marked in (QUICK,) if chosen.quick else survived:
                if (suite, marked) not in usual:
                    fine, usual[suite, marked] = survives(module, None, suite, marked, LONGEST)
                    assert fine, f"{suite} ({marked}) fail without a change"
                    said = f"    {usual[suite, marked]:.0f} s, {marked}: {', '.join(suite)}"
                    print(said, file=sys.stderr, flush=True)
                limit = max(LEAST, FACTOR * usual[suite, marked])
                survived[marked], _ = survives(module, source, suite, marked, limit)
                if not survived[marked]:
                    break
            rows[change] = {"pattern": pattern, "change": change, "survived": all(survived.values())}
            rows[change]["quick"] = survived[QUICK]
            if chosen.kept:
                with chosen.kept.open("a") as file:
                    file.write(json.dumps(rows[change]) + "\n")
            if rows[change]["survived"]:
                print(f"    {change}", flush=True)
    print("| module | changes | noticed | by quick tests |\n|---|---|---|---|")
    for pattern in (*dict.fromkeys(row["pattern"] for row in rows.values()), ""):
        own = [row for row in rows.values() if not pattern or row["pattern"] == pattern]
        noticed = sum(not row["survived"] for row in own)
        quickly = sum(not row.get("quick", row["survived"]) for row in own)
        share = 100 * noticed / max(len(own), 1)
        print(f"| {pattern or 'all'} | {len(own)} | {noticed} ({share:.0f} %) | {quickly} |")


if __name__ == "__main__":
    main()
