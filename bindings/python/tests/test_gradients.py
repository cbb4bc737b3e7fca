"""Derivatives are those of differences of whole simulations, whatever asks for them."""

import pickle
import subprocess
import sys

import numpy as np
import pytest

import caudal

#: A soft tail in a thick fluid, short, with every part that has derivatives; solved to rounding.
SOFT = {
    "solver.integrator": "generalized-alpha",
    "solver.time_step_s": 0.01,
    "solver.duration_s": 0.2,
    "solver.newton_tolerance": 1e-13,
    "rod.youngs_modulus_pa": 4e5,
    "rod.nodes": 7,
    "start.kind": "shaped",
}
FIRST = ["x_m", "y_m", "vx_m_s", "vy_m_s"]


def scene(**changes):
    return caudal.load("models/glycerol.toml", set={**SOFT, **changes})


def total(scene, output, values, weights):
    return float(np.sum(weights * caudal.simulate(scene, output, values).outputs[output]))


def difference(of, values, name, direction, size):
    """The derivative of `of` along a direction of one value, of fourth order: central, or to one side where the other has no scene."""

    def at(steps):
        return of({**values, name: np.asarray(values[name]) + steps * size * direction})

    for places in ({-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}, ONE_SIDED, {-k: -w for k, w in ONE_SIDED.items()}):
        try:
            return sum(weight * at(steps) for steps, weight in places.items()) / size
        except caudal.errors.SceneError:
            continue
    raise AssertionError(f"no scene beside {name}")


#: Weights of the values at whole steps to one side.
ONE_SIDED = {0: -25 / 12, 1: 4.0, 2: -3.0, 3: 4 / 3, 4: -1 / 4}


def own_values(scene):
    return {name: parameter.value for name, parameter in caudal.parameters(scene).items()}


#: Steps of differences where 1e-4 of the value is not best. Shedding is 1 at most, and differences to one side make seven times as much of
#: rounding: at 1e-4 they are off by 3e-8 to 1.1e-7, at 1e-2 by 2.7e-9, which is the rounding of the adjoint (1e-8 of the output).
SIZES = {"joint_stiffness_n_m2": 1e-3, "force_x_n": 1e-3, "force_y_n": 1e-3, "x_m": 1e-5, "y_m": 1e-5, "reactive.shedding": 1e-2}


@pytest.mark.parametrize("method", ["implicit-euler", "newmark", "generalized-alpha"])
@pytest.mark.parametrize("output", ["x_com_m", "viscous_work_j", "tip_y_m", "x_m", "vy_m_s"])
def test_every_parameter_has_the_derivative_of_differences(output, method):
    own = scene(**{"solver.integrator": method})
    assert {"rod.length_m", "rod.outer_radius_m", "rod.density_kg_m3", "actuation.wavelength_m"} <= set(caudal.parameters(own))
    values = own_values(own)
    # The stiffness of the joints takes their place.
    follow = ["rod.youngs_modulus_pa", "rod.stiffness_gradient"]
    worst = compared(own, output, {name: value for name, value in values.items() if name not in follow})
    assert worst[0] <= 1e-7, worst  # measured: 2.5e-8, of differences
    print(f"{output} {method}: {worst[0]:.1e}")


#: Scenes with profiles, an added mass, interfaces, a driven head, gravity, a body at the head, and what they are asked for.
BODIES = {
    "eel": ["x_com_m", "wake_work_j", "cycle_efficiency"],
    "dipping-tail": ["head_force_y_n", "load_work_j", "spray_work_j"],
    "sperm": ["y_com_m", "body_angle_rad"],
    "fish": ["numerical_dissipation_j"],
}


@pytest.mark.parametrize("model", BODIES)
def test_every_number_of_a_body_and_its_medium_has_the_derivative_of_differences(model):
    changes = {"rod.nodes": 9, "solver.newton_tolerance": 1e-13}
    own = caudal.load(f"models/{model}.toml", set=changes)
    step = own.parameters["solver.time_step_s"]
    own = caudal.load(own, set={"solver.duration_s": 25 * step if model != "eel" else 1.0})
    if model == "dipping-tail":
        # At rest its drag has a kink, at which differences over any step are others: 3e-4 apart.
        own = caudal.load(own, set={"medium.flow_m_s": [0.1, 0.0]})
    known = caudal.parameters(own)
    for output in BODIES[model]:
        if output.startswith("cycle_"):
            names = ["rod.length_m", "rod.outer_radius_m", "rod.depth_m", "actuation.envelope"]
            _, found = caudal.value_and_grad(own, output, names)
            for name in names:
                value = known[name].value
                direction = np.linspace(0.5, 1.0, np.size(value)).reshape(np.shape(value))
                expected = difference(lambda v: caudal.value_and_grad(own, output, [], v)[0], {name: value}, name, direction, 1e-4 * np.max(value))
                assert np.sum(direction * found[name]) == pytest.approx(expected, rel=1e-6), (output, name)
            continue
        size = np.max(np.abs(caudal.simulate(own, output).outputs[output]))
        # A dissipation is what is left of energies, and so is its rounding: measured 1.3e-13 of the fluid's.
        energy = np.max(caudal.simulate(own, "fluid_energy_j").outputs["fluid_energy_j"]) if output == "numerical_dissipation_j" else 0.0
        for name in (name for name in known if "." in name):
            value = known[name].value
            if name == "rod.inner_radius_m" and value == 0.0:
                # A solid rod: mass and stiffness begin with the square of it. Measured: 9e-6 of the derivative by the outer radius, of the fish.
                by = caudal.value_and_grad(own, output, [name, "rod.outer_radius_m"])[1]
                assert abs(by[name]) <= 2e-5 * np.max(np.abs(by["rod.outer_radius_m"]))
                continue
            along = ALONG.get(name) if model == "dipping-tail" else None
            error, exact, expected = compared(own, output, {name: value}, along)
            # What hardly matters is lost in the rounding of differences: measured 1.7e-11 of the output.
            noise = max(5e-11 * size, 4e-13 * energy) / (1e-4 * (np.max(np.abs(value)) or 1.0))
            # A node that comes to an interface meets a kink: measured 1.1e-5.
            allowed = 3e-5 if name.startswith("medium.beyond") else 1e-6
            assert abs(exact - expected) <= allowed * abs(exact) + noise, (output, name, exact, expected, noise)
            print(f"{model} {output} {name}: {error:.1e}")


#: Where an interface leaves one direction; a derivative across is none.
ALONG = {"medium.flow_m_s": np.array([1.0, 0.0]), "loads.gravity_m_s2": np.array([0.0, 1.0])}


def compared(own, output, values, along=None):
    """The largest error of the derivatives of an output by `values` over their size, with both derivatives."""
    dice = np.random.default_rng(1)
    simulation = caudal.simulate(own, output, values)
    weights = dice.standard_normal(simulation.outputs[output].shape)
    found = simulation.pull_back({output: weights}, list(values))
    worst = (0.0, 0.0, 0.0)
    for name, value in values.items():
        direction = dice.standard_normal(np.shape(value))
        if np.ndim(value) == 0:
            direction = np.asarray(1.0)
        elif along is not None:
            direction = along
            assert np.all(found[name][along == 0.0] == 0.0)
        typical = float(np.max(np.abs(value))) or 1.0
        size = SIZES.get(name, 1e-4) * (typical if name not in SIZES else 1.0)
        if name == "joint_stiffness_n_m2":
            size = 1e-3 * typical
        expected = difference(lambda values: total(own, output, values, weights), values, name, direction, size)
        exact = float(np.sum(direction * found[name]))
        scale = float(np.sqrt(np.sum((direction * found[name]) ** 2))) or 1.0
        worst = max(worst, (abs(exact - expected) / scale, exact, expected))
    return worst


@pytest.mark.parametrize("output", ["tip_y_m", "actuation_work_j", "x_m"])
def test_controls_over_time_have_the_derivatives_of_differences(output):
    own = scene()
    times = len(caudal.simulate(own, "x_com_m").times_s)
    dice = np.random.default_rng(2)
    known = caudal.parameters(own)
    values = {
        "natural_curvature_1_m": dice.standard_normal((times, len(known["natural_curvature_1_m"].value))),
        "force_y_n": 1e-3 * dice.standard_normal((times, own.nodes)),
    }
    simulation = caudal.simulate(own, output, values)
    weights = dice.standard_normal(simulation.outputs[output].shape)
    found = simulation.pull_back({output: weights}, list(values))
    for name, size in (("natural_curvature_1_m", 1e-3), ("force_y_n", 1e-4)):
        direction = dice.standard_normal(values[name].shape)
        expected = difference(lambda values: total(own, output, values, weights), values, name, direction, size)
        exact = float(np.sum(direction * found[name]))
        scale = float(np.sqrt(np.sum((direction * found[name]) ** 2)))
        assert abs(exact - expected) <= 1e-6 * scale, (name, exact, expected, scale)


def test_controls_are_what_a_stepper_does_that_sets_its_inputs_before_each_step():
    own = scene(**{"solver.integrator": "implicit-euler"})
    times = caudal.simulate(own, "x_com_m").times_s
    natural = np.random.default_rng(3).standard_normal((len(times), len(caudal.parameters(own)["natural_curvature_1_m"].value)))
    natural[0] = 0.0
    path = caudal.simulate(own, ["x_m", "vy_m_s"], {"natural_curvature_1_m": natural}).outputs
    tail = caudal.Stepper(own)
    for n in range(1, len(times)):
        tail.set("natural_curvature_1_m", natural[n])
        tail.do_step(times[n] - times[n - 1])
        np.testing.assert_allclose(path["x_m"][n], tail.get("x_m"), rtol=0, atol=1e-10)
    np.testing.assert_allclose(path["vy_m_s"][-1], tail.get("vy_m_s"), rtol=0, atol=1e-8)


def test_a_value_and_its_gradient_are_those_of_a_run():
    own = scene()
    value, gradient = caudal.value_and_grad(own, "net_displacement_m", ["actuation.kappa_amp", "joint_stiffness_n_m2", "x_m"])
    assert value == pytest.approx(caudal.run(own).summary["net_displacement_m"], rel=1e-9)
    assert gradient["x_m"].shape == (own.nodes,)
    # The whole rod moved at the start moves the net displacement nowhere.
    assert abs(np.sum(gradient["x_m"])) <= 1e-9


def test_means_over_cycles_have_the_derivatives_of_differences():
    own = scene(**{"solver.duration_s": 1.0})
    mean, gradient = caudal.value_and_grad(own, "cycle_forward_speed_m_s", ["actuation.kappa_amp", "medium.viscosity_pa_s"])
    assert mean == pytest.approx(caudal.run(own).summary["cycle_forward_speed_m_s"], rel=1e-8)
    for name, exact in gradient.items():
        value = caudal.parameters(own)[name].value

        def of(values, name=name):
            return caudal.value_and_grad(own, "cycle_forward_speed_m_s", [], values)[0]

        expected = difference(of, {name: value}, name, 1.0, 1e-4 * value)
        assert exact == pytest.approx(expected, rel=1e-6)


def test_a_simulation_comes_back_from_a_pickle_and_shows_itself():
    simulation = caudal.simulate(scene(), ["tip_y_m", "x_m"], {"medium.viscosity_pa_s": 2.0})
    again = pickle.loads(pickle.dumps(simulation))
    for name, values in simulation.outputs.items():
        np.testing.assert_array_equal(values, again.outputs[name])
    weights = {"tip_y_m": np.ones_like(simulation.times_s)}
    assert again.pull_back(weights, ["rod.length_m"]) == simulation.pull_back(weights, ["rod.length_m"])
    assert "tip_y_m" in simulation._repr_html_()


def test_first_states_that_are_given_in_part_leave_the_others_to_the_scene():
    own = caudal.load(scene(), set={"start": {"kind": "shaped"}})
    given = {"x_m": caudal.parameters(own)["x_m"].value}
    key = "actuation.kappa_amp"
    value, gradient = caudal.value_and_grad(own, "tip_y_m", key, given)
    assert value == caudal.simulate(own, "tip_y_m", given).outputs["tip_y_m"][-1]
    kappa = caudal.parameters(own)[key].value
    expected = difference(lambda values: caudal.simulate(own, "tip_y_m", {**given, **values}).outputs["tip_y_m"][-1], {key: kappa}, key, 1.0, 1e-4 * kappa)
    assert gradient[key] == pytest.approx(expected, rel=1e-6)


def test_simulations_carry_the_notes_of_a_run():
    coarse = caudal.load(scene(), set={"solver.time_step_s": 0.05, "solver.duration_s": 0.5})
    notes = caudal.run(coarse, record=[]).notes
    simulation = caudal.simulate(coarse, "tip_y_m")
    assert notes and simulation.notes == notes
    found = caudal.value_and_grad(coarse, "tip_y_m", "actuation.kappa_amp")
    value, gradient = found
    assert found.notes == notes and value == simulation.outputs["tip_y_m"][-1]


def test_what_has_no_derivative_is_refused_by_name():
    own = scene()
    times = len(caudal.simulate(own, "x_com_m").times_s)
    joints = len(caudal.parameters(own)["natural_curvature_1_m"].value)
    with pytest.raises(ValueError, match="allowed: .*medium.viscosity_pa_s"):
        caudal.simulate(own, "x_com_m", {"solver.duration_s": 1.0})
    with pytest.raises(ValueError, match="actuation.envelope: found 1 values; allowed: 2"):
        caudal.simulate(own, "x_com_m", {"actuation.envelope": 1.0})
    with pytest.raises(caudal.errors.SceneError, match="did you mean `length_m`"):
        caudal.simulate(own, "x_com_m", {"rod.length": 1.0})
    with pytest.raises(ValueError, match="has no derivative by `solver.time_step_s`; allowed: "):
        caudal.value_and_grad(own, "x_com_m", "solver.time_step_s")
    with pytest.raises(caudal.errors.UnknownVariableError, match="x_com_m"):
        caudal.value_and_grad(own, "x_comm_m", "medium.viscosity_pa_s")
    with pytest.raises(ValueError, match=r"allowed: \(5,\)|allowed: \("):
        caudal.simulate(own, "x_com_m", {"natural_curvature_1_m": np.zeros(joints + 1)})
    with pytest.raises(ValueError, match="rate is not given"):
        given = {"natural_curvature_1_m": np.zeros((times, joints))}
        caudal.value_and_grad(own, "actuation_power_w", "natural_curvature_1_m", given)
    with pytest.raises(caudal.errors.SceneError, match="method of one stage"):
        caudal.parameters(caudal.load("models/glycerol.toml", set={"solver.integrator": "esdirk3"}))


def steered(function, lib, own, target, steps, rate, gradient_of):
    """A policy, two numbers per joint, that brings the tip to a target: the losses on the way."""
    losses = []
    policy = np.zeros(2 * len(caudal.parameters(own)["natural_curvature_1_m"].value))
    for _ in range(steps):
        loss, slope = gradient_of(policy)
        losses.append(float(loss))
        policy = policy - rate * np.asarray(slope)
    return losses


def policy_rows(lib, policy, times):
    """Natural curvature over time: a constant and a ramp at each joint."""
    half = policy.shape[0] // 2
    ramp = lib.asarray(times / times[-1])[:, None]
    return policy[None, :half] + ramp * policy[None, half:]


def test_jax_differentiates_compiles_and_trains():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp

    import caudal.jax

    own = scene()
    times = caudal.simulate(own, "x_com_m").times_s
    simulated = caudal.jax.function(own, ["tip_x_m", "tip_y_m"])

    def loss(policy):
        path = simulated({"natural_curvature_1_m": policy_rows(jnp, policy, times)})
        return 1e3 * (path["tip_y_m"][-1] - 0.05) ** 2

    gradient_of = jax.jit(jax.value_and_grad(loss))
    joints = len(caudal.parameters(own)["natural_curvature_1_m"].value)
    begun = np.linspace(-1, 1, 2 * joints)
    exact = np.asarray(gradient_of(begun)[1])
    direction = np.random.default_rng(5).standard_normal(exact.shape)
    numeric = difference(lambda v: float(loss(v["p"])), {"p": begun}, "p", direction, 1e-3)
    assert float(exact @ direction) == pytest.approx(numeric, rel=1e-6)
    losses = steered(simulated, jnp, own, 0.05, 25, 3.0, gradient_of)
    assert losses[-1] < 0.02 * losses[0], losses
    both = jax.vmap(lambda amplitude: simulated({"actuation.kappa_amp": amplitude})["tip_y_m"][-1])(jnp.array([0.5, 1.0]))
    assert both.shape == (2,) and float(both[0]) != float(both[1])


def test_a_failing_run_under_jax_tells_its_reason_last():
    jax = pytest.importorskip("jax")
    import caudal.jax

    simulated = caudal.jax.function(scene(), ["tip_y_m"])

    def last(amplitude):
        return simulated({"actuation.kappa_amp": amplitude})["tip_y_m"][-1]

    for call, amplitude in [(last, 1e9), (jax.grad(last), 1e9), (jax.vmap(last), np.array([1.0, 1e9]))]:
        with pytest.raises(caudal.errors.FoldOverError, match="^the rod folds over") as failed:
            call(amplitude)
        assert failed.value.__cause__ is None and failed.value.__context__ is None
    last(1.0)  # what was called before changes JAX's class, not ours
    with pytest.raises(caudal.errors.FoldOverError):
        last(1e9)
    with pytest.raises(jax.errors.JaxRuntimeError) as failed:
        jax.jit(last)(1e9)
    assert str(failed.value).strip().splitlines()[-1].startswith("FoldOverError: the rod folds over")


def test_torch_differentiates_and_trains():
    torch = pytest.importorskip("torch", reason="PyTorch: target/hosts/bin/pip install torch (5 GB, as its wheels bring CUDA)")
    import caudal.torch

    own = scene()
    times = caudal.simulate(own, "x_com_m").times_s
    simulated = caudal.torch.function(own, ["tip_y_m"])

    def loss(policy):
        path = simulated({"natural_curvature_1_m": policy_rows(torch, policy, times)})
        return 1e3 * (path["tip_y_m"][-1] - 0.05) ** 2

    joints = len(caudal.parameters(own)["natural_curvature_1_m"].value)
    policy = torch.linspace(-1, 1, 2 * joints, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(loss, (policy,), eps=1e-5, atol=1e-6, rtol=1e-5)
    policy = torch.zeros(2 * joints, dtype=torch.float64, requires_grad=True)
    optimiser = torch.optim.SGD([policy], lr=3.0)
    losses = []
    for _ in range(25):
        optimiser.zero_grad()
        now = loss(policy)
        now.backward()
        optimiser.step()
        losses.append(float(now.detach()))
    assert losses[-1] < 0.02 * losses[0], losses


def test_second_derivatives_in_torch_are_refused_and_not_zero():
    torch = pytest.importorskip("torch", reason="PyTorch: target/hosts/bin/pip install torch (5 GB, as its wheels bring CUDA)")
    simulated = caudal.torch.function(scene(), "tip_y_m")
    viscosity = torch.tensor(2.0, dtype=torch.float64, requires_grad=True)
    loss = simulated({"medium.viscosity_pa_s": viscosity})["tip_y_m"][-1] + viscosity**2
    (slope,) = torch.autograd.grad(loss, viscosity, create_graph=True)
    assert slope.isfinite()
    with pytest.raises(NotImplementedError, match="first derivatives only"):
        torch.autograd.grad(slope, viscosity)


def test_modules_with_packages_of_their_own_are_there_when_they_are_used():
    program = "import caudal; import sys; before = 'caudal.gymnasium' in sys.modules; print(before, caudal.gymnasium.TailEnv.__name__)"
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert found == "False TailEnv\n"
    with pytest.raises(AttributeError, match="no attribute 'tensorflow'"):
        caudal.tensorflow  # noqa: B018


def test_torch_takes_the_type_of_the_first_tensor_of_floats_and_texts_as_names():
    torch = pytest.importorskip("torch", reason="PyTorch: target/hosts/bin/pip install torch (5 GB, as its wheels bring CUDA)")
    import caudal.torch

    simulated = caudal.torch.function(scene(), "tip_y_m")
    exact = simulated({"medium.viscosity_pa_s": torch.tensor(2.0, dtype=torch.float64)})["tip_y_m"]
    assert exact.dtype == torch.float64 and exact.abs().max() > 0
    for two in (torch.tensor(2), torch.tensor(2.0), 2.0):
        path = simulated({"medium.viscosity_pa_s": two})["tip_y_m"]
        assert path.is_floating_point() and torch.allclose(path.double(), exact, rtol=1e-6)


def test_a_mean_over_cycles_is_no_output_over_time():
    with pytest.raises(caudal.errors.DerivativeError, match="cycle_thrust_n: found a mean over cycles.*value_and_grad"):
        caudal.simulate("models/silicone-tail.toml", "cycle_thrust_n")


def test_wrong_values_of_parameters_are_named():
    for name, value, problem in [
        ("actuation_phase_rad", [], r"found the shape \(0,\); allowed: \(1,\)"),
        ("actuation_phase_rad", [0.0, 1.0], r"found the shape \(2,\); allowed: \(1,\)"),
        ("actuation_phase_rad", np.nan, "found NaN; allowed: finite numbers"),
        ("joint_stiffness_n_m2", np.nan, "found NaN; allowed: finite numbers"),
        ("medium.viscosity_pa_s", [1.0, 2.0], "found 2 values; allowed: 1"),
    ]:
        with pytest.raises(ValueError, match=f"{name}: {problem}"):
            caudal.simulate(scene(), "tip_y_m", {name: value})


def test_a_missing_package_says_what_to_install(monkeypatch):
    for name in ("jax", "torch"):
        monkeypatch.setitem(sys.modules, name, None)
        monkeypatch.delitem(sys.modules, f"caudal.{name}", raising=False)
        with pytest.raises(ImportError, match=rf'pip install "caudal\[{name}\]"'):
            __import__(f"caudal.{name}")


def test_what_cannot_be_weighed_or_named_is_refused_with_a_remedy():
    scene = caudal.load("models/glycerol.toml", {"solver.duration_s": 0.05})
    known = caudal.parameters(scene)
    for there, name in [(known, "rod.lenght_m"), (scene.parameters, "rod.lenght_m"), (caudal.Stepper(scene).variables, "tip_y")]:
        with pytest.raises(caudal.errors.UnknownVariableError, match="did you mean `(rod.length_m|tip_y_m)`"):
            there[name]
    simulation = caudal.simulate(scene, ["tip_y_m"])
    weights = np.ones_like(simulation.outputs["tip_y_m"])
    with pytest.raises(caudal.errors.DerivativeError, match=r"no derivative by `rod.lenght_m`; did you mean `rod.length_m`\?"):
        simulation.pull_back({"tip_y_m": weights}, ["rod.lenght_m"])
    with pytest.raises(ValueError, match="not finite"):
        simulation.pull_back({"tip_y_m": weights * np.nan}, ["rod.length_m"])
    with pytest.raises(TypeError, match="weights: found list; allowed: a dict"):
        simulation.pull_back([weights], ["rod.length_m"])


def test_messages_speak_of_python_s_own_words(tmp_path):
    with pytest.raises(caudal.errors.SceneError) as wrong:
        caudal.load("models/glycerol.toml", {"rod.lenght_m": 0.2})
    assert "--set" not in str(wrong.value) and "did you mean `length_m`" in str(wrong.value)
    with pytest.raises(caudal.errors.SceneError, match="`caudal.sweep` runs it"):
        caudal.load("models/sweep-resonance.toml")


def test_a_first_state_does_not_move_the_node_that_a_head_holds():
    own = caudal.load("models/driven-head.toml", set={"solver.duration_s": 0.1})
    start = caudal.parameters(own)["x_m"].value
    gradient = caudal.value_and_grad(own, "tip_y_m", "x_m", {"x_m": start})[1]["x_m"]
    assert gradient[0] == 0.0 and gradient[1] != 0.0
    with pytest.raises(caudal.errors.DerivativeError, match="x_m: found 0.1 at node 0, which the head holds at 0; allowed"):
        caudal.simulate(own, "tip_y_m", {"x_m": start + 0.1})


def test_weights_and_values_are_numbers():
    short = caudal.load("models/glycerol.toml", set={"solver.duration_s": 0.05})
    simulation = caudal.simulate(short, "tip_y_m")
    for wrong in (1j * np.ones(simulation.times_s.size), ["1"] * simulation.times_s.size, [None] * simulation.times_s.size):
        with pytest.raises(TypeError, match="weights of tip_y_m: found an array of the shape"):
            simulation.pull_back({"tip_y_m": wrong}, "medium.viscosity_pa_s")
    for wrong in (2 + 1j, "2", None):
        with pytest.raises(TypeError, match="medium.viscosity_pa_s: found .*; allowed: a number"):
            caudal.simulate(short, "tip_y_m", {"medium.viscosity_pa_s": wrong})
    found = simulation.pull_back({"tip_y_m": simulation.times_s == simulation.times_s[-1]}, "medium.viscosity_pa_s")
    twice = caudal.value_and_grad(short, "tip_y_m", ["medium.viscosity_pa_s", "medium.viscosity_pa_s"])[1]
    assert found == twice == caudal.value_and_grad(short, "tip_y_m", "medium.viscosity_pa_s")[1]


def test_jax_takes_real_numbers_and_suggests_names():
    pytest.importorskip("jax")
    import caudal.jax

    simulated = caudal.jax.function(caudal.load("models/glycerol.toml", set={"solver.duration_s": 0.05}), "tip_y_m")
    with pytest.raises(TypeError, match="medium.viscosity_pa_s: found the type complex"):
        simulated({"medium.viscosity_pa_s": 1.0 + 1j})
    with pytest.raises(ValueError, match="`medium.viscosity_pa` has no derivative; did you mean `medium.viscosity_pa_s`"):
        simulated({"medium.viscosity_pa": 1.0})


def stepped(inputs=("force_y_n",), outputs=("tip_y_m", "bending_energy_j")):
    tail = caudal.Stepper("models/glycerol.toml")
    tail.do_step(0.1)
    begin = tail.save()
    found = tail.linearize(0.01, inputs=list(inputs), outputs=list(outputs))
    end, read = tail.motion(), [tail.get(name) for name in outputs]
    tail.restore(begin)
    return tail, found, end, read


def test_a_step_is_a_function_of_jax_in_both_modes():
    jax = pytest.importorskip("jax")
    import caudal.jax

    jax.config.update("jax_enable_x64", True)
    tail, found, end, read = stepped()
    step = caudal.jax.step(tail, 0.01, ["force_y_n"], ["tip_y_m", "bending_energy_j"])
    state, force = tail.motion(), np.zeros(tail.scene.nodes)
    there, outs = jax.jit(step)(state, force)
    np.testing.assert_allclose(there, end, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(outs, read, rtol=1e-9)
    for mode in (jax.jacfwd, jax.jacrev):
        (a, b), (c, d) = mode(step, argnums=(0, 1))(state, force)
        for one, other in [(a, found.a), (b, found.b), (c, found.c), (d, found.d)]:
            np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-7 * np.abs(other).max())
    alone = caudal.jax.step(tail, 0.01, outputs="tip_y_m")
    np.testing.assert_allclose(jax.grad(lambda z: alone(z)[1][0])(state), found.c[0], rtol=1e-6, atol=1e-9)


def test_a_step_that_fails_under_jax_raises_its_own_error():
    jax = pytest.importorskip("jax")
    import caudal.jax

    jax.config.update("jax_enable_x64", True)
    tail = stepped()[0]
    step = caudal.jax.step(tail, 0.01, outputs="tip_y_m")
    state = tail.motion()
    several = jax.vmap(lambda z: step(z)[1])
    for call in (step, jax.grad(lambda z: step(z)[1][0]), lambda z: several(z[None])):
        for wrong in (state * np.nan, state * 1e3):
            with pytest.raises(caudal.Error) as failed:
                call(wrong)
            assert failed.value.__cause__ is None and failed.value.__context__ is None
    with pytest.raises(caudal.Error):
        step(state[:-1])
    with pytest.raises(jax.errors.JaxRuntimeError):
        jax.jit(step)(state * np.nan)


def test_a_step_is_a_function_of_pytorch():
    torch = pytest.importorskip("torch")
    import caudal.torch

    tail, found, end, read = stepped()
    step = caudal.torch.step(tail, 0.01, ["force_y_n"], ["tip_y_m", "bending_energy_j"])
    state = torch.tensor(tail.motion(), requires_grad=True)
    force = torch.zeros(tail.scene.nodes, dtype=torch.float64, requires_grad=True)
    there, outs = step(state, force)
    np.testing.assert_allclose(there.detach().numpy(), end, rtol=1e-9, atol=1e-11)
    (there @ torch.ones_like(there) + outs[0]).backward()
    np.testing.assert_allclose(state.grad, found.a.sum(axis=0) + found.c[0], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(force.grad, found.b.sum(axis=0) + found.d[0], rtol=1e-7, atol=1e-7)
