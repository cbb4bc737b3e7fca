"""The stepper: rollback to the bit, snapshots across processes, inputs and outputs, threads, and what a call costs."""

import gc
import copy
import pickle
import subprocess
import sys
import threading
import tracemalloc
import warnings

import numpy as np
import pytest

import caudal

STATE = ["x_m", "y_m", "vx_m_s", "vy_m_s", "curvature_1_m", "viscous_work_j", "newton_iterations"]


def state(tail):
    return [tail.get(name) for name in STATE]


def same(a, b):
    return all(np.array_equal(x, y) for x, y in zip(a, b))


def test_steps_are_the_run_s_to_the_bit(scene):
    result = caudal.run(scene, record=["x_m", "y_m"])
    with caudal.Stepper(scene) as tail:
        np.testing.assert_array_equal(tail.get("x_m"), result["x_m"][0])
        step = result["time_s"][1]
        for row in range(1, min(len(result["time_s"]), 60)):
            tail.do_step(step)
            assert tail.time_s == result["time_s"][row]
            np.testing.assert_array_equal(tail.get("y_m"), result["y_m"][row])


def test_rollback_is_equal_to_the_bit_at_random_times(scene):
    random = np.random.default_rng(7)
    tail = caudal.Stepper(scene)
    for _ in range(20):
        tail.do_step(random.uniform(1e-4, 2e-2))
        force = random.normal(scale=1e-3, size=scene.nodes)
        before, begin, rest = tail.save(), state(tail), random.uniform(1e-4, 2e-2)

        def go_on():
            tail.set("force_y_n", force)
            tail.do_step(rest)
            return state(tail)

        there = go_on()
        tail.restore(before)
        assert same(state(tail), begin) and tail.time_s == before.time_s
        assert same(go_on(), there)
        tail.restore(bytes(before))
        assert same(go_on(), there)


def test_a_snapshot_goes_on_in_another_process(tmp_path):
    tail = caudal.Stepper("models/driven-head.toml")
    tail.do_step(0.1)
    (tmp_path / "snapshot").write_bytes(bytes(tail.save()))
    script = (
        "import caudal, sys; tail = caudal.Stepper('models/driven-head.toml'); "
        "tail.restore(open(sys.argv[1], 'rb').read()); tail.do_step(0.05); print(tail.get('tip_y_m').hex())"
    )
    there = subprocess.run([sys.executable, "-c", script, tmp_path / "snapshot"], capture_output=True, text=True, check=True)
    tail.do_step(0.05)
    assert float.fromhex(there.stdout) == tail.get("tip_y_m")


def test_snapshots_of_other_scenes_and_damaged_ones_are_refused():
    one = caudal.Stepper("models/glycerol.toml")
    other = caudal.Stepper(caudal.load("models/glycerol.toml", set={"medium.viscosity_pa_s": 0.5}))
    saved = bytes(one.save())
    for wrong in [other.save(), bytes(other.save()), b"", b"no snapshot", saved[:-1], saved[:-1] + bytes([saved[-1] ^ 1])]:
        with pytest.raises(caudal.errors.SnapshotError):
            one.restore(wrong)
    with pytest.raises(TypeError):
        one.restore(3)
    one.restore(saved)


def test_a_snapshot_is_pickled_and_copied_and_one_of_another_version_is_refused():
    tail = caudal.Stepper("models/driven-head.toml")
    tail.set("head_angle_rad", 0.1)
    tail.do_step(0.1)
    saved = tail.save()
    tail.do_step(0.05)
    after = tail.get("tip_y_m")
    for again in (pickle.loads(pickle.dumps(saved)), copy.copy(saved), copy.deepcopy(saved)):
        assert repr(again) == repr(saved) and bytes(again) == bytes(saved)
        tail.restore(again)
        tail.do_step(0.05)
        assert tail.get("tip_y_m") == after
    with pytest.raises(caudal.errors.SnapshotError, match="another scene"):
        caudal.Stepper("models/glycerol.toml").restore(again)
    version = caudal.__version__.encode()
    other = pickle.dumps(saved).replace(version, b"9" * len(version))
    with pytest.raises(caudal.errors.SnapshotError, match="it was saved by caudal 9"):
        pickle.loads(other)
    damaged = bytearray(pickle.dumps(saved))
    damaged[len(damaged) // 2] ^= 1
    with pytest.raises(caudal.errors.SnapshotError, match="damaged"):
        pickle.loads(bytes(damaged))


def test_a_scene_is_pickled_with_its_overrides():
    scene = caudal.load("models/driven-head.toml", set={"rod.nodes": 12, "solver.integrator": "esdirk3"})
    again = pickle.loads(pickle.dumps(scene))
    assert (again.name, again.nodes, again.parameters) == (scene.name, 12, scene.parameters)
    one, two = caudal.Stepper(scene), caudal.Stepper(again)
    two.restore(bytes(one.save()))  # the same scene, to its fingerprint
    with pytest.raises(TypeError):
        pickle.dumps(one)


def test_variables_know_their_units_shapes_and_causalities():
    tail = caudal.Stepper("models/driven-head.toml")
    variables = tail.variables
    assert list(variables)[0] == "time_s"
    for name, variable in variables.items():
        assert variable.name == name and variable.description and variable.unit
        assert variable.causality in ("independent", "output", "input", "parameter")
        value = tail.get(name)
        assert np.shape(value) == variable.shape
        assert isinstance(value, np.ndarray if variable.shape else float)
        if variable.causality == "input":
            before = tail.save()
            tail.set(name, value)
            tail.restore(before)
        else:
            with pytest.raises(caudal.errors.NotAnInputError):
                tail.set(name, value)


def test_inputs_take_numbers_lists_and_arrays_of_any_memory():
    tail = caudal.Stepper("models/glycerol.toml")
    count = tail.variables["natural_curvature_1_m"].shape[0]
    wanted = np.linspace(0, 1, count)
    spread = np.zeros(2 * count)
    spread[::2] = wanted
    for given in [wanted, list(wanted), tuple(wanted), spread[::2], wanted.astype(">f8"), np.ma.array(wanted)]:
        tail.set("natural_curvature_1_m", 0)
        tail.set("natural_curvature_1_m", given)
        np.testing.assert_array_equal(tail.get("natural_curvature_1_m"), wanted)
    for number in [2, 2.0, np.float32(2), np.int8(2), np.array(2.0), True + 1]:
        tail.set("natural_curvature_1_m", 0)
        tail.set("natural_curvature_1_m", number)
        np.testing.assert_array_equal(tail.get("natural_curvature_1_m"), np.full(count, 2.0))
    before = state(tail)
    for wrong, kind in [
        ([1, 2], caudal.errors.WrongLengthError),
        (np.full(count, np.nan), caudal.errors.BadValueError),
        (np.inf, caudal.errors.BadValueError),
        (np.zeros((count, 1)), TypeError),
        ("many", TypeError),
        (None, (TypeError, ValueError)),
    ]:
        with pytest.raises(kind):
            tail.set("natural_curvature_1_m", wrong)
    assert same(state(tail), before)


def test_several_inputs_are_set_as_one_or_not_at_all():
    tail = caudal.Stepper("models/glycerol.toml")
    tail.set_all({"viscosity_pa_s": 2, "flow_x_m_s": 0.1, "force_x_n": np.zeros(9)})
    assert (tail.get("viscosity_pa_s"), tail.get("flow_x_m_s")) == (2.0, 0.1)
    with pytest.raises(caudal.errors.BadValueError) as caught:
        tail.set_all({"flow_x_m_s": 0.5, "viscosity_pa_s": -1})
    assert (caught.value.name, caught.value.value) == ("viscosity_pa_s", -1.0) and caught.value.allowed
    assert tail.get("flow_x_m_s") == 0.1


def test_an_input_goes_on_along_its_derivatives():
    tail = caudal.Stepper("models/glycerol.toml")
    tail.set_derivative("flow_x_m_s", 1, 2.0)
    tail.do_step(0.01)
    assert tail.get("flow_x_m_s") == pytest.approx(0.02, rel=1e-12)
    for order, kind in [(0, ValueError), (9, caudal.errors.OrderError)]:
        with pytest.raises(kind):
            tail.set_derivative("flow_x_m_s", order, 2.0)


def test_a_head_that_jumps_is_warned_of():
    tail = caudal.Stepper(caudal.load("models/driven-head.toml", set={"rod.nodes": 9}))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(5):
            tail.do_step(0.002)
    tail.set("head_vy_m_s", tail.get("pose_vy_m_s") + 5.0)
    with pytest.warns(RuntimeWarning, match="velocity y given for the head"):
        tail.do_step(0.002)
    tail.set("head_x_m", 0.5)
    with pytest.warns(RuntimeWarning, match="position x given for the head"):
        tail.do_step(0.002)


def test_what_a_host_says_of_the_media_is_what_a_scene_says_of_them():
    said = {"interface_1_offset_m": 0.02, "beyond_1_viscosity_pa_s": 0.1, "beyond_1_density_kg_m3": 900.0}
    keys = {"medium.beyond.offset_m": 0.02, "medium.beyond.viscosity_pa_s": 0.1, "medium.beyond.density_kg_m3": 900.0}
    told = caudal.Stepper("models/dipping-tail.toml")
    own = caudal.Stepper(caudal.load("models/dipping-tail.toml", set=keys))
    told.set_all(said)
    for tail in told, own:
        tail.do_step(0.1)
    assert told.get("spray_work_j") > 0.0
    np.testing.assert_allclose(told.get("y_m"), own.get("y_m"), rtol=1e-12)  # measured: equal


def test_arrays_that_are_given_are_filled_and_returned():
    tail = caudal.Stepper("models/glycerol.toml")
    room = np.empty(9)
    assert tail.get("x_m", out=room) is room
    np.testing.assert_array_equal(room, tail.get("x_m"))
    scalar = np.empty(1)
    assert tail.get("tip_y_m", out=scalar)[0] == tail.get("tip_y_m")
    with pytest.raises(caudal.errors.WrongLengthError):
        tail.get("x_m", out=np.empty(8))
    frozen = np.empty(9)
    frozen.flags.writeable = False
    for wrong in [frozen, np.empty(18)[::2], np.empty(9, dtype="float32"), [0.0] * 9]:
        with pytest.raises((TypeError, ValueError)):
            tail.get("x_m", out=wrong)


def test_mistakes_are_exceptions_with_the_library_s_fields():
    tail = caudal.Stepper("models/glycerol.toml")
    for out in (np.zeros(9, np.float32), np.zeros((9, 1)), [0.0] * 9):
        with pytest.raises(TypeError, match="out: allowed: a NumPy array of one dimension and the type float64"):
            tail.get("x_m", out=out)
    fixed = np.zeros(9)
    fixed.flags.writeable = False
    for out in (fixed, np.zeros(18)[::2]):
        with pytest.raises(TypeError, match="out: .*; allowed: an array that is contiguous, aligned and writeable"):
            tail.get("x_m", out=out)
    with pytest.raises(TypeError, match="value: found None; allowed: a number"):
        tail.set("viscosity_pa_s", None)
    with pytest.raises(caudal.errors.UnknownVariableError, match="it needs a held head"):
        tail.get("head_force_x_n")
    with pytest.raises(caudal.errors.UnknownVariableError, match="did you mean `tip_x_m`") as caught:
        tail.get("tip_x")
    assert (caught.value.name, caught.value.nearest) == ("tip_x", "tip_x_m") and isinstance(caught.value, KeyError)
    for h in [0.0, -1.0, float("nan"), float("inf")]:
        with pytest.raises(caudal.errors.StepError) as caught:
            tail.do_step(h)
        assert caught.value.value == h or h != h
    for h in ["soon", None]:
        with pytest.raises(TypeError, match=f"h: found {h!r}; allowed: a time, s"):
            tail.do_step(h)
    for call in (lambda: tail.get(None), lambda: tail.set(None, 1.0), lambda: tail.set_derivative(None, 1, 1.0)):
        with pytest.raises(TypeError, match="name: found None; allowed: the name of a variable"):
            call()
    before = tail.save()
    tail.set("force_y_n", [0, 0, 1e12, 0, -1e12, 0, 0, 0, 0])
    with pytest.raises(caudal.Error) as caught:
        tail.do_step(0.01)
    assert isinstance(caught.value, ArithmeticError) and caught.value.node >= 0
    assert np.isfinite(tail.get("x_m")).all() and tail.time_s < 0.01
    tail.restore(before)  # what the force did to the tail on the way is undone, and so is the force
    tail.do_step(1e-3)
    tail.close()
    for use in [lambda: tail.do_step(1e-3), lambda: tail.get("x_m"), lambda: tail.time_s, tail.save]:
        with pytest.raises(ValueError, match="closed"):
            use()


def test_wrong_scenes_say_where():
    with pytest.raises(caudal.errors.SceneError) as caught:
        caudal.load("models/glycerol.toml", set={"rod.length_mm": 3})
    assert caught.value.key == "rod.length_mm" and "did you mean `length_m`" in caught.value.problem
    assert isinstance(caught.value, ValueError)
    with pytest.raises(caudal.errors.ReadError) as caught:
        caudal.load("models/none.toml")
    assert caught.value.path == "models/none.toml" and isinstance(caught.value, OSError)
    for wrong in [3, None, object(), b"models/glycerol.toml"]:
        with pytest.raises(TypeError):
            caudal.load(wrong)
    with pytest.raises(TypeError, match="cannot be part of a scene"):
        caudal.load("models/glycerol.toml", set={"rod.nodes": None})


def test_a_scene_can_be_a_dictionary():
    tables = {
        "rod": {"nodes": 5, "length_m": 1, "outer_radius_m": 0.01, "youngs_modulus_pa": 1e6, "density_kg_m3": 1e3},
        "loads": {"gravity_m_s2": [0.0, -9.81], "point": [{"node": -1, "force_n": [0.0, 1e-3]}]},
        "head": {"kind": "clamped"},
        "solver": {"time_step_s": 1e-3, "duration_s": 0.01},
    }
    result = caudal.run(tables)
    assert result.complete and result["tip_dy_m"][-1] < 0
    with pytest.raises(caudal.errors.SceneError):
        caudal.load({**tables, "rods": {}})


def test_two_threads_step_in_parallel_and_one_stepper_is_no_meeting_place():
    scene = caudal.load("models/driven-head.toml", set={"rod.nodes": 2000})
    busy = caudal.Stepper(scene)
    thread = threading.Thread(target=busy.do_step, args=(1.0,))
    thread.start()
    # This thread steps another one while that one is in the middle of a single call.
    mine, steps, refused = caudal.Stepper("models/glycerol.toml"), 0, 0
    while thread.is_alive():
        mine.do_step(1e-3)
        steps += 1
        try:
            busy.get("x_m")
        except RuntimeError as error:
            assert "another thread" in str(error)
            refused += 1
    thread.join()
    assert steps > 20 and refused > 20
    assert busy.time_s == 1.0 and abs(mine.time_s - steps * 1e-3) < 1e-9


def test_a_step_makes_nothing_in_memory():
    tail, room = caudal.Stepper("models/baseline-smooth.toml"), np.empty(9)
    for _ in range(10):
        tail.do_step(5e-3)
        tail.get("x_m", out=room)
    gc.collect()
    tracemalloc.start()
    before = tracemalloc.take_snapshot()
    for _ in range(500):
        tail.do_step(5e-3)
        tail.get("x_m", out=room)
    growth = tracemalloc.take_snapshot().compare_to(before, "filename")
    tracemalloc.stop()
    assert sum(entry.size_diff for entry in growth if "tracemalloc" not in str(entry.traceback)) < 2000


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_package_carries_what_an_fmu_needs(fmi, tmp_path):
    fmpy = pytest.importorskip("fmpy")
    scene = caudal.load("models/glycerol.toml", set={"rod.nodes": 17})
    path = tmp_path / "tail.fmu"
    scene.fmu(path, fmi=fmi)
    step, count = 0.01, 5
    fmu = fmpy.simulate_fmu(str(path), stop_time=count * step, output_interval=step, output=["tip_y_m"])
    tail = caudal.Stepper(scene)
    for found in fmu["tip_y_m"][1:]:
        tail.do_step(step)
        assert found == tail.get("tip_y_m")
    with pytest.raises(caudal.errors.ReadError):
        scene.fmu(tmp_path / "other.fmu", library=tmp_path / "absent.so")
    assert not (tmp_path / "other.fmu").exists()


def test_what_are_no_real_numbers_is_refused_by_its_argument():
    tail = caudal.Stepper("models/glycerol.toml")
    before = tail.get("natural_curvature_1_m")
    count = before.size
    for wrong in [1j, "1e3", None, object(), [None] * count, ["1"] * count, [1j] * count, np.full(count, 1 + 1j), np.full(count, None)]:
        with pytest.raises(TypeError, match="^value: found .*; allowed: a number, or an array of numbers"):
            tail.set("natural_curvature_1_m", wrong)
        with pytest.raises(TypeError, match="^natural_curvature_1_m: found "):
            tail.set_all({"viscosity_pa_s": 2.0, "natural_curvature_1_m": wrong})
    with pytest.raises(TypeError, match=r"value: found the shape \(7, 2\); allowed: a number, or numbers in one dimension"):
        tail.set("natural_curvature_1_m", np.zeros((7, 2)))
    with pytest.raises(ValueError, match="value: found lists of different lengths"):
        tail.set("natural_curvature_1_m", [[1.0], [1.0, 2.0]])
    np.testing.assert_array_equal(tail.get("natural_curvature_1_m"), before)
    for right in [1, np.float32(1.0), np.ones(count, dtype=int), [1] * count, (1.0,) * count]:
        tail.set("natural_curvature_1_m", right)
        assert set(tail.get("natural_curvature_1_m")) == {1.0}
    with pytest.raises(caudal.errors.UnknownVariableError, match="did you mean `tip_y_m`"):
        tail.get("TIP_Y_M")


#: A tail in water that nothing but a host moves.
STILL = {
    "rod": {"nodes": 9, "length_m": 0.1, "outer_radius_m": 0.002, "youngs_modulus_pa": 1e6, "density_kg_m3": 1000.0},
    "reactive": "auto",
    "medium": {"viscosity_pa_s": 1e-3, "density_kg_m3": 1000.0},
    "drag": {"law": "auto"},
    "head": {"kind": "driven"},
    "solver": {"time_step_s": 2e-3, "duration_s": 0.2},
}


def test_auto_that_judged_a_rod_at_rest_is_warned_of():
    text = "nothing in the scene moves this rod"
    with pytest.warns(RuntimeWarning, match=text):
        caudal.Stepper(STILL)
    assert any(text in note for note in caudal.load(STILL).check())
    assert any(text in note for note in caudal.run(STILL).summary["notes"])
    named = {**STILL, "drag": {"law": "cross-flow"}, "reactive": {}}
    moving = {**STILL, "head": {"kind": "driven", "angle_rad": {"amplitude": 0.1, "frequency_hz": 2.0}}}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for scene in (named, moving):
            caudal.Stepper(scene)


def test_the_matrices_of_a_step_are_those_of_differences(scene):
    tail, size = caudal.Stepper(scene), 1e-6
    tail.do_step(0.05)
    begin, motion = tail.save(), tail.motion()
    tail.set_motion(motion)
    start = tail.save()
    inputs, outputs = ["force_y_n"], ["tip_y_m", "bending_energy_j"]
    step = tail.linearize(0.01, inputs=inputs, outputs=outputs)
    n, nodes = len(motion), scene.nodes
    assert (step.a.shape, step.b.shape) == ((n, n), (n, nodes))
    assert (step.c.shape, step.d.shape) == ((2, n), (2, nodes))
    assert (len(step.states), step.inputs[1], step.outputs) == (n, "force_y_n[1]", outputs)
    assert step.units["bending_energy_j"] == "J" and step.units[step.states[-1]] == "m/s"
    end = tail.motion()
    tail.restore(start)
    tail.do_step(0.01)
    np.testing.assert_array_equal(tail.motion(), end)

    def read(by, force):
        tail.restore(start)
        tail.set_motion(motion + by)
        tail.set("force_y_n", force)
        tail.do_step(0.01)
        return np.concatenate([tail.motion(), [tail.get(name) for name in outputs]])

    direction = np.random.default_rng(3).normal(size=n) * np.repeat([1.0, 10.0], n // 2)
    ends = [read(sign * size * direction, 0.0) for sign in (1, -1)]
    found = np.concatenate([step.a @ direction, step.c @ direction])
    np.testing.assert_allclose(found, (ends[0] - ends[1]) / (2 * size), rtol=1e-4, atol=5e-5)  # measured 1.3e-5: differences at the scenes' tolerances
    ends = [read(0.0 * direction, np.full(nodes, sign * 1e-3)) for sign in (1, -1)]
    found = np.concatenate([step.b.sum(axis=1), step.d.sum(axis=1)])
    np.testing.assert_allclose(found, (ends[0] - ends[1]) / 2e-3, rtol=1e-3, atol=5e-5)  # measured 1.2e-4 and 6e-6

    full = tail.linearize(0.01, coordinates="full")
    assert len(full.states) >= 3 * n // 2
    tail.restore(begin)


def test_inputs_alone_have_the_columns_that_they_have_beside_the_state(scene):
    tail = caudal.Stepper(scene)
    tail.do_step(0.05)
    start = tail.save()
    step = tail.linearize(0.01, inputs=["force_y_n"], outputs=["tip_y_m"])
    tail.restore(start)
    alone = tail.linearize(0.01, inputs="force_y_n", outputs="tip_y_m", states=False)
    assert (alone.a.shape, alone.c.shape) == ((len(step.states), 0), (1, 0))
    np.testing.assert_allclose(alone.b, step.b, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(alone.d, step.d, rtol=1e-12, atol=1e-14)


def test_steps_of_an_input_that_stays_compose_without_its_jump(scene):
    tail = caudal.Stepper(caudal.load(scene, set={"solver.integrator": "generalized-alpha", "solver.time_step_s": 1e-3}))
    tail.do_step(0.01)
    tail.set_motion(tail.motion())
    h, start = tail.get("time_step_s"), tail.save()
    whole = tail.linearize(2 * h, inputs="force_y_n", coordinates="full")
    tail.restore(start)
    first = tail.linearize(h, inputs="force_y_n", coordinates="full")
    second = tail.linearize(h, inputs="force_y_n", coordinates="full", jump=False)
    np.testing.assert_allclose(second.a @ first.b + second.b, whole.b, rtol=1e-6, atol=1e-9 * np.abs(whole.b).max())
    np.testing.assert_allclose(second.a @ first.a, whole.a, rtol=1e-6, atol=1e-9 * np.abs(whole.a).max())


def test_what_has_no_matrix_of_a_step_says_so(scene):
    tail = caudal.Stepper(scene)
    for arguments, problem in [
        (dict(outputs=["viscous_work_j"]), "viscous_work_j has no derivative of a step"),
        (dict(inputs=["tip_y_m"]), "tip_y_m"),
        (dict(inputs=["no_such"]), "no_such"),
        (dict(inputs=3), "inputs: found 3; allowed: a name, or a list of names"),
        (dict(coordinates="some"), 'coordinates: found "some"; allowed: "motion", "full"'),
    ]:
        with pytest.raises((caudal.Error, ValueError, TypeError), match=problem):
            tail.linearize(0.01, **arguments)
    assert tail.time_s == 0.0
    with pytest.raises(caudal.Error):
        tail.set_motion([0.0, 1.0, 2.0])
    with pytest.raises(caudal.Error):
        tail.set_motion(np.full(len(tail.motion()), np.nan))
