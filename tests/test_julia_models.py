"""Models of the ecosystem, unchanged, as domains. Each is skipped where its package or Julia is missing."""

from __future__ import annotations

import numpy as np
import pytest

import harness
from harness import bridge
from harness.play.evaluation import evaluate

if not bridge.is_set_up():
    pytest.skip("no Julia is set up for the harness (see `harness julia`)", allow_module_level=True)

pytestmark = pytest.mark.filterwarnings("default")

QUICK = """
QuickPOMDP(
    states = ["left", "right"], actions = ["left", "right", "listen"], observations = ["left", "right"],
    transition = (s, a) -> a == "listen" ? Deterministic(s) : Uniform(["left", "right"]),
    observation = (s, a, sp) -> a != "listen" ? Uniform(["left", "right"]) :
        SparseCat([sp, sp == "left" ? "right" : "left"], [0.85, 0.15]),
    reward = (s, a) -> a == "listen" ? -1.0 : s == a ? -100.0 : 10.0,
    initialstate = Uniform(["left", "right"]), discount = 0.95,
)"""
EXPLICIT = """
DiscreteExplicitPOMDP(
    [:left, :right], [:left, :right, :listen], [:left, :right],
    (s, a, sp) -> a == :listen ? Float64(s == sp) : 0.5,
    (a, sp, o) -> a == :listen ? (o == sp ? 0.85 : 0.15) : 0.5,
    (s, a) -> a == :listen ? -1.0 : s == a ? -100.0 : 10.0, 0.95,
)"""
MODELS = {
    "tiger": ("POMDPModels", "TigerPOMDP()", (2, 3, 2)),
    "baby": ("POMDPModels", "BabyPOMDP()", (2, 2, 2)),
    "tmaze": ("POMDPModels", "TMaze()", (23, 4, 5)),
    "minihallway": ("POMDPModels", "MiniHallway()", (13, 3, 9)),
    "tabular": (
        "POMDPModels",
        "TabularPOMDP(fill(0.5, 2, 3, 2), [1.0 0.0 0.0; 0.0 1.0 0.0], fill(0.5, 2, 3, 2), 0.9)",
        (2, 3, 2),
    ),
    "rocks": (
        "RockSample",
        "RockSamplePOMDP(map_size = (3, 3), rocks_positions = [(1, 2), (3, 1)])",
        (37, 7, 3),
    ),
    "momdp": (
        "MOMDPs",
        f'Base.include(@__MODULE__, raw"{bridge.package_folder() / "test" / "momdp_model.jl"}")\nDoors()',
        (8, 2, 2),
    ),
    "quick": ("QuickPOMDPs", QUICK, (2, 3, 2)),
    "explicit": ("QuickPOMDPs", EXPLICIT, (2, 3, 2)),
}

IN_JULIA = """(file, episodes, horizon) -> begin
    m = Base.include(Module(), file)
    play(k) = begin
        simulator = RolloutSimulator(; rng = Xoshiro(k), max_steps = horizon)
        policy = RandomPolicy(m; rng = Xoshiro(episodes + k))
        Base.invokelatest(simulate, simulator, m, policy, NothingUpdater(), Base.invokelatest(initialstate, m))
    end
    return [play(k) for k in 1:episodes]
end"""


def write(folder, name, text):
    path = folder / f"{name}.jl"
    path.write_text(text)
    return str(path)


@pytest.fixture(scope="module", params=MODELS)
def model(request, tmp_path_factory):
    package, text, sizes = MODELS[request.param]
    if bridge.julia().seval("name -> Base.find_package(name) === nothing")(package):
        pytest.skip(f"the Julia package {package} is not installed")
    path = write(tmp_path_factory.mktemp("model"), request.param, f"using {package}, POMDPTools\n{text}")
    return path, harness.load(path), sizes


def test_it_is_a_domain_that_conforms(model):
    _, domain, sizes = model
    assert (domain.n_states, domain.n_actions, domain.n_observations) == sizes
    harness.check_domain(domain, engine="julia")


def test_chance_earns_what_it_earns_in_pomdps_jl(model):
    """Both engines play the same episodes; the reference is POMDPs.jl's own simulator on the file's model."""
    path, domain, _ = model
    played, again = (evaluate(domain, "random", episodes=4000, horizon=20, engine=name) for name in ("julia", "tables"))
    assert np.array_equal(played.returns, again.returns)
    import juliacall

    scope = juliacall.newmodule("Reference")
    scope.seval("using PomdpHarness: POMDPs, POMDPTools, Random")
    scope.seval("using .POMDPs, .POMDPTools, .Random")
    reference = np.array(scope.seval(IN_JULIA)(path, 4000, 20))
    error = np.hypot(reference.std(), played.discounted.std()) / 4000**0.5
    assert abs(played.discounted.mean() - reference.mean()) <= 4 * error + 1e-9


def test_a_model_of_momdps_jl_has_a_visible_part(tmp_path):
    package, text, _ = MODELS["momdp"]
    if bridge.julia().seval("name -> Base.find_package(name) === nothing")(package):
        pytest.skip(f"the Julia package {package} is not installed")
    domain = harness.load(write(tmp_path, "doors", f"using {package}\n{text}"))
    assert domain.n_visible == 4
    assert domain.n_joint == 2
    assert [tuple(values) for values in domain.visible_values] == [(1,), (2,), (3,), (4,)]


@pytest.mark.parametrize(
    ("package", "text", "message"),
    [
        ("POMDPModels", "LightDark1D()", r"wrong\.jl: LightDark1D is no finite model: it has no states\(m\)"),
        (
            "QuickPOMDPs",
            "QuickPOMDP(states = 1:2, actions = 1:2, observations = 1:2, discount = 0.9, initialstate = "
            "Deterministic(1), gen = (s, a, rng) -> (sp = s, o = s, r = 0.0))",
            r"wrong\.jl: No definition of .transition.",
        ),
    ],
)
def test_what_is_no_finite_explicit_model_is_refused(package, text, message, tmp_path):
    if bridge.julia().seval("name -> Base.find_package(name) === nothing")(package):
        pytest.skip(f"the Julia package {package} is not installed")
    with pytest.raises(harness.JuliaError, match=message):
        harness.load(write(tmp_path, "wrong", f"using {package}, POMDPTools\n{text}"))
