"""Model files: what they say, against models worked out by hand; and that writing and reading lose nothing."""

from __future__ import annotations

import gzip
import shutil
import subprocess

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import harness
from harness import engine, registry
from harness.cli import main
from harness.errors import HarnessError
from harness.formats import limits

from .conftest import FULL, size
from .models import Builder, brute_force, rocksample, tiger

TIGER = """# a door with a tiger behind it, and one with gold
discount: 0.95
values: reward
states: left right
actions: listen open-left open-right
observations: hear-left hear-right
start: uniform
T:listen identity
T: open-left
uniform
T: open-right : * uniform
O: listen
0.85 0.15
0.15 0.85
O: open-left uniform
O: open-right : * : * 0.5
R: listen : * : * : * -1
R: * : * : * : * 10
R: listen : * : * : * -1
R: open-left : left : * : * -100
R: open-right : right : * : * -1e2
"""

HEAD = """discount: 0.9
values: reward
states: a b c
actions: go stay
observations: x y
"""
BODY = """T: go uniform
T: stay identity
O: * uniform
R: * : * : * : * 1
"""


def read(tmp_path, text, name="model.pomdp"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return harness.load(path)


def transitions(d, visible=0):
    """(A, S, S) of a flat domain."""
    return _dense(d, visible, d.arrays["outcome_probability"])


def rewards(d, visible=0):
    """(A, S, S) what is paid on the ways that there are."""
    return _dense(d, visible, d.arrays["outcome_reward"][0])


def _dense(d, visible, numbers):
    t, n = d.arrays, d.factor_sizes[0]
    table = np.zeros((d.n_actions, n, n))
    for a in range(d.n_actions):
        for x in range(n):
            row = t["first_row"][visible * d.n_actions + a] + x
            for j in range(t["row_outcomes"][row], t["row_outcomes"][row + 1]):
                table[a, x, t["outcome_value"][j]] = numbers[j]
    return table


def prior(d):
    return d.arrays["prior_marginals"][0].tolist()


def test_tiger_is_worth_what_it_is_by_hand(tmp_path):
    d = read(tmp_path, TIGER)
    assert d.actions == ("listen", "open-left", "open-right")
    assert d.factor_labels == (("left", "right"),)
    assert d.name == "model.pomdp"
    for depth in (1, 2, 3, 4):
        assert brute_force(d, depth) == pytest.approx(brute_force(tiger(), depth), abs=1e-12)


def test_a_packed_file_is_the_same(tmp_path):
    d = read(tmp_path, TIGER)
    (tmp_path / "model.pomdp.gz").write_bytes(gzip.compress(TIGER.encode()))
    assert harness.load(tmp_path / "model.pomdp.gz") == d


def test_the_last_statement_that_fits_decides(tmp_path):
    body = """T: * : * : a 1.0
T: go : b : * 0.25
T: go : b : a 0.5
T: * : c
0 0 1
T: 1 : 1 : 0 0.0
T: 1 : 1 : 1 1.0
O: * uniform
O: go : a : x 1
O: go : a : y 0
R: * : * : * : * 1
R: go : * : a : * 2
R: * : a : * : * 3
R: go : a : b : * 4
"""
    d = read(tmp_path, HEAD + body)
    assert transitions(d).tolist() == [
        [[1, 0, 0], [0.5, 0.25, 0.25], [0, 0, 1]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    ]
    assert rewards(d).tolist() == [
        [[3, 0, 0], [2, 1, 1], [0, 0, 1]],
        [[3, 0, 0], [0, 1, 0], [0, 0, 1]],
    ]
    t = d.arrays
    assert t["observation_probability"][t["outcome_observation"][0]].tolist() == [1, 0]
    assert t["observation_probability"][t["outcome_observation"][-1]].tolist() == [0.5, 0.5]


@pytest.mark.parametrize(
    ("start", "expected"),
    [
        ("", [1 / 3, 1 / 3, 1 / 3]),
        ("start: uniform", [1 / 3, 1 / 3, 1 / 3]),
        ("start: 0.5 0.25 0.25", [0.5, 0.25, 0.25]),
        ("start: b", [0, 1, 0]),
        ("start: 2", [0, 0, 1]),
        ("start include: a 2", [0.5, 0, 0.5]),
        ("start exclude: b", [0.5, 0, 0.5]),
    ],
)
def test_starts(tmp_path, start, expected):
    d = read(tmp_path, f"{HEAD}{start}\n{BODY}T: stay : a reset\n")
    assert prior(d) == expected
    assert transitions(d)[1].tolist() == [expected, [0, 1, 0], [0, 0, 1]]  # reset is the start


def test_costs_readings_in_rewards_and_matrices_of_them(tmp_path):
    body = """T: * identity
O: * : * : x 0.25
O: * : * : y 0.75
R: go : a : * : x 8
R: go : b
1 2
3 7
5 6
R: stay : c : c
4 0
"""
    d = read(tmp_path, HEAD.replace("reward", "cost") + body)
    assert np.diagonal(rewards(d), axis1=1, axis2=2).tolist() == [[-2, -6, 0], [0, 0, -1]]  # ¼·8; ¼·3 + ¾·7; ¼·4
    assert any("what is expected" in note for note in d.notes)


def test_without_observations_it_is_an_mdp(tmp_path):
    text = "discount: 1.0\nstates: 2\nactions: 1\nT: 0 : * : 1 1\nR: 0 : 0 : 1 7\n"
    d = read(tmp_path, text)
    assert d.observations == ("none",)
    assert d.factor_labels == (("s0", "s1"),)
    assert brute_force(d, 3) == 3.5  # half the time it starts in state 0 and is paid once


def test_where_nothing_is_paid_any_more_is_the_end(tmp_path):
    body = """start: a
T: go : * : b 1
T: stay identity
T: * : b
0 0 1
T: * : c
0 0 1
O: * uniform
R: go : a : * : * 5
"""
    d = read(tmp_path, HEAD + body)
    over = d.arrays["terminal"][d.arrays["outcome_visible"]]
    values = d.arrays["outcome_value"]
    assert set(values[over].tolist()) == {1, 2}
    assert set(values[~over].tolist()) == {0}
    assert brute_force(d, 4) == 5


def test_distributions_that_a_file_rounds_are_scaled(tmp_path):
    d = read(tmp_path, HEAD + BODY.replace("T: go uniform", "T: go : * : * 0.33333"))
    assert transitions(d)[0].sum(axis=1) == pytest.approx([1, 1, 1], abs=1e-15)
    assert any("scaled" in note for note in d.notes)


CORRIDOR = """<?xml version="1.0" encoding="ISO-8859-1"?>
<pomdpx version="1.0" id="corridor"><Description>a walk past two lamps</Description><Discount>0.9</Discount>
<Variable>
<StateVar vnamePrev="cell_0" vnameCurr="cell_1" fullyObs="true"><ValueEnum>west middle out</ValueEnum></StateVar>
<StateVar vnamePrev="one_0" vnameCurr="one_1"><ValueEnum>off on</ValueEnum></StateVar>
<StateVar vnamePrev="two_0" vnameCurr="two_1" fullyObs="false"><NumValues>2</NumValues></StateVar>
<ObsVar vname="seen"><ValueEnum>dark bright</ValueEnum></ObsVar>
<ActionVar vname="do"><ValueEnum>look walk</ValueEnum></ActionVar>
<RewardVar vname="toll"/><RewardVar vname="prize"/>
</Variable>
<InitialStateBelief>
<CondProb><Var>cell_0</Var><Parent>null</Parent><Parameter><Entry><Instance>-</Instance>
<ProbTable>1 0 0</ProbTable></Entry></Parameter></CondProb>
<CondProb><Var>one_0</Var><Parent>null</Parent><Parameter type="TBL"><Entry><Instance>-</Instance>
<ProbTable>uniform</ProbTable></Entry></Parameter></CondProb>
<CondProb><Var>two_0</Var><Parent>null</Parent><Parameter type="TBL"><Entry><Instance>-</Instance>
<ProbTable>0.25 0.75</ProbTable></Entry></Parameter></CondProb>
</InitialStateBelief>
<StateTransitionFunction>
<CondProb><Var>cell_1</Var><Parent>cell_0 do</Parent><Parameter type="TBL">
<Entry><Instance>- look -</Instance><ProbTable>identity</ProbTable></Entry>
<Entry><Instance>west walk -</Instance><ProbTable>0.1 0.9 0</ProbTable></Entry>
<Entry><Instance>middle walk out</Instance><ProbTable>1</ProbTable></Entry>
<Entry><Instance>out walk out</Instance><ProbTable>1</ProbTable></Entry></Parameter></CondProb>
<CondProb><Var>one_1</Var><Parent>one_0</Parent><Parameter type="TBL">
<Entry><Instance>- -</Instance><ProbTable>1 0 0 1</ProbTable></Entry></Parameter></CondProb>
{two}
</StateTransitionFunction>
<ObsFunction><CondProb><Var>seen</Var><Parent>do two_1 one_1 cell_1</Parent><Parameter type="TBL">
<Entry><Instance>* * * * dark</Instance><ProbTable>1.0</ProbTable></Entry>
{seen}
</Parameter></CondProb></ObsFunction>
<RewardFunction>
<Func><Var>toll</Var><Parent>do</Parent><Parameter type="TBL">
<Entry><Instance>walk</Instance><ValueTable>-1</ValueTable></Entry></Parameter></Func>
<Func><Var>toll</Var><Parent>cell_0</Parent><Parameter type="TBL">
<Entry><Instance>out</Instance><ValueTable>0</ValueTable></Entry></Parameter></Func>
<Func><Var>prize</Var><Parent>cell_0 two_0 do cell_1</Parent><Parameter type="TBL">
<Entry><Instance>middle s1 walk -</Instance><ValueTable>0 0 10</ValueTable></Entry>
<Entry><Instance>out * walk *</Instance><ValueTable>1</ValueTable></Entry></Parameter></Func>
</RewardFunction></pomdpx>
"""
SEEN = """<Entry><Instance>look * - west -</Instance><ProbTable>0.8 0.2 0.2 0.8</ProbTable></Entry>
<Entry><Instance>look s1 * middle -</Instance><ProbTable>0.1 0.9</ProbTable></Entry>"""
BOTH = """<Entry><Instance>look - - west -</Instance><ProbTable>0.8 0.2 0.2 0.8 0.2 0.8 0.8 0.2</ProbTable></Entry>"""
TWO = """<CondProb><Var>two_1</Var><Parent>two_0 cell_0 do</Parent><Parameter type="TBL">
<Entry><Instance>- * * -</Instance><ProbTable>identity</ProbTable></Entry>
<Entry><Instance>* middle look -</Instance><ProbTable>0.5 0.5</ProbTable></Entry></Parameter></CondProb>"""
DIAGRAM = """<CondProb><Var>two_1</Var><Parent>two_0 cell_0 do</Parent><Parameter type="DD"><DAG><Node var="cell_0">
<Edge val="west"><SubDAG type="template" idref="keep"/></Edge>
<Edge val="middle"><Node var="do"><Edge val="look"><SubDAG type="uniform" var="two_1"/></Edge>
<Edge val="walk"><Node var="two_0"><Edge val="s0"><SubDAG type="deterministic" var="two_1" val="0"/></Edge>
<Edge val="s1"><Node var="two_1"><Edge val="s0"><Terminal>0.0</Terminal></Edge><Edge val="s1"><Terminal>1.0</Terminal>
</Edge></Node></Edge></Node></Edge></Node></Edge>
<Edge val="out"><SubDAG type="template" idref="keep"/></Edge></Node></DAG>
<SubDAGTemplate id="keep"><SubDAG type="persistent" var="two_1"/></SubDAGTemplate></Parameter></CondProb>"""


def corridor(two=TWO, seen=SEEN):
    return CORRIDOR.format(two=two, seen=seen)


def by_hand(seen):
    """The corridor as a builder's tables over the joint value of both lamps: one factor of four values."""
    b = Builder([4], 2, 2)
    dark = b.reading([1, 0])
    for v in range(2):
        look, walk = [], []
        for x in range(4):
            one, two = divmod(x, 2)
            reads = [seen(v, one, after) for after in (0, 1)]
            after = [(two, 1.0)] if v == 0 else [(0, 0.5), (1, 0.5)]
            look.append([(v, 2 * one + y, p, b.reading(reads[y]), 0.0) for y, p in after])
            paid = -1.0 + (10.0 if v == 1 and two == 1 else 0.0)
            walk.append([(0, x, 0.1, dark, paid), (1, x, 0.9, dark, paid)] if v == 0 else [(2, x, 1.0, dark, paid)])
        b.choice(0, look)
        b.choice(0, walk)
    b.end()
    return b.domain("by hand", 0.9, [False, False, True], 0, [[0.125, 0.375, 0.125, 0.375]])


def look_at_one(v, one, two):
    bright = 0.2 + 0.6 * one if v == 0 else 0.9 * two
    return [1 - bright, bright]


def look_at_both(v, one, two):
    bright = (0.2 if one == two else 0.8) if v == 0 else 0.0
    return [1 - bright, bright]


def test_pomdpx_variables_become_the_visible_part_and_factors(tmp_path):
    d = read(tmp_path, corridor(), "corridor.pomdpx")
    assert d.visible_names == ("cell",)
    assert d.factors == ("one", "two")
    assert d.arrays["terminal"].tolist() == [False, False, True]
    assert d.arrays["factor"].tolist() == [0, -1, 1, 1, -1, -1]  # look and walk in the west, in the middle, outside
    assert [name for name, *_ in d.features] == ["belief(1)", "belief(2)"]
    for depth in (1, 2, 3, 4):
        assert brute_force(d, depth) == pytest.approx(brute_force(by_hand(look_at_one), depth), abs=1e-12)


def test_a_decision_diagram_says_the_same_as_a_table(tmp_path):
    table = read(tmp_path, corridor(), "corridor.pomdpx")
    diagram = read(tmp_path, corridor(DIAGRAM), "corridor.pomdpx")
    assert diagram.model_hash == table.model_hash


def test_variables_that_a_step_ties_become_one_factor(tmp_path):
    d = read(tmp_path, corridor(seen=BOTH), "corridor.pomdpx")
    assert d.factors == ("one+two",)
    assert d.factor_labels == (("off,s0", "off,s1", "on,s0", "on,s1"),)
    assert "as steps or the start tie variables" in d.notes[0]
    for depth in (1, 2, 3, 4):
        assert brute_force(d, depth) == pytest.approx(brute_force(by_hand(look_at_both), depth), abs=1e-12)


def test_variables_that_the_start_ties_become_one_factor(tmp_path):
    tied = corridor().replace("<Var>two_0</Var><Parent>null</Parent>", "<Var>two_0</Var><Parent>one_0</Parent>")
    tied = tied.replace(
        "<Instance>-</Instance>\n<ProbTable>0.25 0.75", "<Instance>- -</Instance>\n<ProbTable>0 1 0.5 0.5"
    )
    d = read(tmp_path, tied, "corridor.pomdpx")
    assert d.factors == ("one+two",)
    assert prior(d) == [0, 0.5, 0.25, 0.25]


def test_a_reward_for_a_reading(tmp_path):
    paid = (
        corridor()
        .replace("<Parent>do</Parent>", "<Parent>do seen</Parent>")
        .replace("<Instance>walk</Instance><ValueTable>-1", "<Instance>look bright</Instance><ValueTable>10")
    )
    d = read(tmp_path, paid, "corridor.pomdpx")
    # in the west: bright with 0.2 or 0.8, so 2 or 8; in the middle 0 or 9; and to walk costs nothing now
    first = d.arrays["first_row"]
    reward = d.arrays["outcome_reward"][0]
    assert reward[d.arrays["row_outcomes"][first[0] : first[0] + 2]] == pytest.approx([2, 8])
    assert reward[d.arrays["row_outcomes"][first[2]] : d.arrays["row_outcomes"][first[2]] + 2] == pytest.approx([0, 9])


def test_rocksample_out_and_in_again(tmp_path):
    d = rocksample(3, [(1, 0), (2, 2)], (0, 1))
    assert harness.write_model(d, tmp_path / "rocks.pomdpx.gz") == []
    again = harness.load(tmp_path / "rocks.pomdpx.gz")
    _assert_same_arrays(d, again)
    assert again.actions == d.actions
    harness.write_model(d, tmp_path / "rocks.pomdp")
    flat = harness.load(tmp_path / "rocks.pomdp")
    assert (flat.n_states, flat.factor_sizes) == (37, (37,))  # nine cells × four, and the end
    assert brute_force(flat, 4) == pytest.approx(brute_force(d, 4), abs=1e-12)


def _assert_same_arrays(d, again):
    """To the last bit; readings may be numbered in another order."""
    for name, array in _arrays(d).items():
        assert np.array_equal(array, _arrays(again)[name]), name


def _arrays(d):
    read = d.arrays["observation_probability"][d.arrays["outcome_observation"]]
    own = {name: array for name, array in d.arrays.items() if "observation_" not in name + "_" or "start" in name}
    return own | {"read": read}


@settings(max_examples=size(12, 200), deadline=None)
@given(st.integers(0, 10**9), st.integers(1, 5), st.integers(1, 3), st.integers(1, 4))
def test_any_flat_model_is_the_same_after_writing_and_reading(tmp_path_factory, seed, n, n_actions, n_observations):
    rng, folder = np.random.default_rng(seed), tmp_path_factory.mktemp("flat")
    T, O = _rows(rng, n_actions, n, n), _rows(rng, n_actions, n, n_observations)  # noqa: E741
    R = rng.normal(0, 10, (n_actions, n, n)) * rng.integers(0, 2, (n_actions, n, 1))
    if rng.random() < 0.5:  # a state that is the end
        T[:, -1], R[:, -1] = np.eye(n)[-1], 0
    b0 = rng.dirichlet(np.ones(n))
    b0 = np.eye(n)[0] if rng.random() < 0.5 or not R[:, -1].any() else b0
    d = harness.from_arrays(T, O, R, b0, float(rng.uniform(0.1, 1)))
    for name in ("model.pomdp", "model.pomdpx"):
        harness.write_model(d, folder / name)
        again = harness.load(folder / name)
        _assert_same_arrays(d, again)
        assert again.model_hash == d.model_hash


def _rows(rng, *shape):
    """Distributions along the last axis, some numbers 0."""
    rows = rng.dirichlet(np.ones(shape[-1]), shape[:-1]) * rng.integers(0, 2, shape)
    rows[..., 0] += rows.sum(axis=-1) == 0
    return rows / rows.sum(axis=-1, keepdims=True)


@settings(max_examples=size(12, 200), deadline=None)
@given(st.integers(0, 10**9), st.lists(st.integers(2, 3), max_size=3), st.integers(1, 3), st.integers(1, 3))
def test_any_factored_model_is_the_same_after_writing_and_reading(tmp_path_factory, seed, sizes, n_visible, n_actions):
    folder = tmp_path_factory.mktemp("factored")
    d = factored(np.random.default_rng(seed), sizes, n_visible, n_actions)
    harness.write_model(d, folder / "model.pomdpx")
    _assert_same_arrays(d, harness.load(folder / "model.pomdpx"))
    harness.write_model(d, folder / "model.pomdp")
    assert brute_force(harness.load(folder / "model.pomdp"), 2) == pytest.approx(brute_force(d, 2), abs=1e-9)


def factored(rng, sizes, n_visible, n_actions):
    """A domain that POMDPX can say exactly: of what is visible and what is hidden, one is sure given the other."""
    b = Builder(sizes, n_actions, 3)
    touches = rng.integers(-1, len(sizes), n_actions)
    read = [
        [[b.reading(rng.dirichlet(np.ones(3))) for _ in range(3 if k >= 0 else 1)] for _ in range(n_visible + 1)]
        for k in touches
    ]
    for _ in range(n_visible):
        for a, k in enumerate(touches):
            b.choice(int(k), [_ways(rng, k, sizes, n_visible, read[a]) for _ in range(sizes[k] if k >= 0 else 1)])
    b.end()
    prior = [rng.dirichlet(np.ones(n)).tolist() for n in sizes]
    return b.domain("factored", 0.9, [False] * n_visible + [True], 0, prior)


def _ways(rng, k, sizes, n_visible, read):
    n = sizes[k] if k >= 0 else 1
    if rng.random() < 0.5:
        visible = sorted(rng.permutation(n_visible + 1)[:2].tolist())
        pairs = [(v, int(rng.integers(n))) for v in visible]
    else:
        visible = int(rng.integers(n_visible + 1))
        pairs = [(visible, x) for x in sorted(rng.permutation(n)[:2].tolist())]
    share = rng.dirichlet(np.ones(len(pairs)))
    paid = rng.normal(0, 1, len(pairs))
    return [(v, x, float(share[i]), read[v][x], float(paid[i])) for i, (v, x) in enumerate(pairs)]


def test_what_moves_together_at_random_is_the_same_to_the_last_digits(tmp_path):
    b = Builder([2], 1, 2)
    read, ways = [b.reading([0.3, 0.7]), b.reading([0.6, 0.4])], [(0, 0, 0.1), (0, 1, 0.2), (1, 0, 0.3), (1, 1, 0.4)]
    b.choice(0, [[(v, x, p, read[x], 1.0) for v, x, p in ways], [(0, 1, 1.0, read[1], 2.0)]])
    b.choice(0, [[(0, x, 1.0, read[x], 3.0)] for x in (0, 1)])
    d = b.domain("tied", 0.9, [False, False], 0, [[0.5, 0.5]])
    harness.write_model(d, tmp_path / "tied.pomdpx")
    again = harness.load(tmp_path / "tied.pomdpx")
    assert np.array_equal(again.arrays["outcome_value"], d.arrays["outcome_value"])
    assert again.arrays["outcome_probability"] == pytest.approx(d.arrays["outcome_probability"], rel=1e-15)


def test_what_no_model_file_can_say_is_refused(tmp_path, hidden):
    with pytest.raises(HarnessError, match=r"read before the first step.*\.npz"):
        harness.write_model(hidden, tmp_path / "model.pomdpx")
    b = Builder([2], 1, 2)
    early, late = b.reading([1, 0]), b.reading([0, 1])
    b.choice(0, [[(0, 0, 1.0, early, 1.0)], [(0, 0, 1.0, late, 0.0)]])
    d = b.domain("backward", 0.9, [False], 0, [[0.5, 0.5]])
    for name in ("model.pomdp", "model.pomdpx"):
        with pytest.raises(HarnessError, match="where the step came from"):
            harness.write_model(d, tmp_path / name)
    with pytest.raises(HarnessError, match=r"states.*export it as pomdpx"):
        harness.write_model(harness.load("rocksample-11x11"), tmp_path / "model.pomdp")
    with pytest.raises(HarnessError, match=r"must end in \.pomdp"):
        harness.write_model(d, tmp_path / "model.txt")


WRONG = {
    "no statement": (HEAD + BODY + "\nQ: a : b 1", r"line 11: 'Q' begins no statement"),
    "a misspelt word": (HEAD.replace("actions", "acitons") + BODY, r"line 4: a colon follows 'acitons'.*'actions'"),
    "no discount": (HEAD.replace("discount: 0.9", "") + BODY, r"no 'discount:'"),
    "no transitions": (HEAD, r"no 'T:'"),
    "a discount of 2": (HEAD.replace("0.9", "2") + BODY, r"line 1: the discount is 2"),
    "a discount that is none": (HEAD.replace("0.9", "much") + BODY, r"line 1: 'much' stands where a number"),
    "values": (HEAD.replace("reward", "joy") + BODY, r"line 2: values are 'joy'"),
    "states twice": (HEAD + "states: 3\n" + BODY, r"line 6: the states are listed a second time"),
    "a state twice": (HEAD.replace("a b c", "a b a") + BODY, r"two states are called 'a'"),
    "a state like a number": (HEAD.replace("a b c", "a 2b c") + BODY, r"'2b' among the states is no name"),
    "no states": (HEAD.replace("a b c", "") + BODY, r"there are no states"),
    "a billion states": (HEAD.replace("a b c", "1000000000") + BODY, r"line 3.*1,000,000,000 are too many, 32,767"),
    "digits without end": (HEAD.replace("a b c", "9" * 5000) + BODY, r"line 3.*are too many"),
    "tables before states": (BODY + HEAD, r"the states are not listed yet"),
    "an unknown state": (HEAD + BODY + "T: go : d : a 1", r"line 10: 'd' is none of the 3 states"),
    "a state out of range": (HEAD + BODY + "T: go : 3 : a 1", r"line 10: '3' is none of the 3 states"),
    "an unknown observation": (HEAD + BODY + "O: go : a : z 1", r"line 10: 'z' is none of the 2 observations"),
    "a row too short": (HEAD + BODY + "T: go : a\n0.5 0.5", r"line 11: the file ends after 2 of 3 numbers"),
    "a word in a row": (HEAD + BODY + "T: go : a\n0.5 half 0", r"line 11: 'half' stands where.*1 of 3"),
    "a number with a mark": (HEAD + BODY + "R: go : a : a : x 1_0", r"line 10: '1_0' stands where a number"),
    "no number": (HEAD + BODY + "R: go : a : a : x nan", r"line 10: 'nan' stands where a number"),
    "a reward without a state": (HEAD + BODY + "R: go 1", r"line 10: R needs 2 of"),
    "the end of a file": (HEAD + BODY + "R: go : a : a : x", r"the file ends where a number is needed"),
    "a colon": (HEAD + BODY + "T go : a 1", r"line 10: T needs 1 of"),
    "a row of 0.9": (HEAD + BODY + "T: go : a\n0.5 0.4 0", r"line 10: the probabilities of state at action go, sta"),
    "a negative one": (HEAD + BODY + "T: go : a\n1.5 -0.5 0", r"line 10: the probabilities of state.*negative"),
    "readings of nothing": (HEAD + BODY.replace("O: * uniform", ""), r"the probabilities of observation at action go"),
    "a start that is none": (HEAD + "start: d\n" + BODY, r"line 6: the start names 'd'"),
    "a start of two": (HEAD + "start: 0.5 0.5\n" + BODY, r"line 6: the start has 2 numbers for 3 states"),
    "a start of 0.9": (HEAD + "start: 0.5 0.4 0.0\n" + BODY, r"line 6: the probabilities of state sum to 0.9"),
    "a start of no state": (HEAD + "start exclude: a b c\n" + BODY, r"line 6: the start leaves no state"),
    "nothing": ("", r"there is no 'discount:'"),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_pomdp_file_is_refused_in_one_sentence(tmp_path, what):
    text, message = WRONG[what]
    with pytest.raises(HarnessError, match=message) as refused:
        read(tmp_path, text)
    assert "model.pomdp" in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


LAUGHS = '<!DOCTYPE pomdpx [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]>'
WRONG_X = {
    "no XML": (("</Variable>", ""), r"line 44: no XML"),
    "another root": (("<pomdpx ", "<model "), r"no XML|no POMDPX"),
    "a bomb": (("<pomdpx ", LAUGHS + "<pomdpx "), r"line 2: a document type \('pomdpx'\)"),
    "a part": (("<Discount>0.9</Discount>", "<Discuont>0.9</Discuont>"), r"line 2: <Discuont>.*'Discount'"),
    "no discount": (("<Discount>0.9</Discount>", ""), r"no <Discount>"),
    "a discount of 0": (("0.9</Discount>", "0</Discount>"), r"line 2: the discount is 0"),
    "a kind of variable": (("<RewardVar", "<RewordVar"), r"line 9: <RewordVar> is no kind"),
    "fullyObs": (('fullyObs="true"', 'fullyObs="yes"'), r"line 4: fullyObs is 'yes'"),
    "no name": (('vname="do"', ""), r"line 8: <ActionVar> needs vname"),
    "one name twice": (('vname="do"', 'vname="seen"'), r"'seen' is the name of two variables"),
    "a value twice": (("off on", "off off"), r"line 5: one_0 has two values of one name"),
    "a wildcard": (("off on", "off *"), r"line 5: '\*' is no name for a value"),
    "a billion values": (("<NumValues>2<", "<NumValues>1000000000<"), r"line 6: values of two_0: 1,000,000,000"),
    "a negative number of values": (("<NumValues>2<", "<NumValues>-2<"), r"line 6: '-2' is no number of values"),
    "an unknown value": (("west walk -", "wset walk -"), r"line 22: 'wset' is none of the 3 values of cell_0.*'west'"),
    "a value too few": (("west walk -", "west walk"), r"line 22: 2 values for 3 variables"),
    "a number too few": (("0.1 0.9 0<", "0.1 0.9<"), r"line 22: 2 numbers where 3 are needed"),
    "a word": (("0.1 0.9 0<", "0.1 most 0<"), r"line 22: 'most' is not a number"),
    "a sum": (("0.1 0.9 0<", "0.1 0.8 0<"), r"line 22: the probabilities of cell at cell west, do walk sum to 0.9"),
    "a parent": (("<Parent>cell_0 do<", "<Parent>cell_0 did<"), r"line 20: 'did' is no variable that"),
    "a parent twice": (("<Parent>cell_0 do<", "<Parent>do do<"), r"line 20: a parent is named twice"),
    "an unknown variable": (("<Var>one_1<", "<Var>on_1<"), r"line 25.*not of 'on_1'.*'one_1'"),
    "no function": (("<Var>one_1<", "<Var>cell_1<"), r"line 25: cell_1 has a second distribution"),
    "an unknown reward": (("<Var>prize<", "<Var>price<"), r"'price' is no <RewardVar>.*'prize'"),
    "an unknown type": (('type="TBL"', 'type="CONT"'), r"type 'CONT' is not read"),
    "identity of one": (("<Instance>- look -<", "<Instance>west look -<"), r"line 21: 'identity' needs two"),
    "no instance": (("<Instance>- look -</Instance>", ""), r"line 21: <Entry> has no <Instance>"),
    "a circle": (("<Parent>one_0</Parent>", "<Parent>one_1</Parent>"), r"one_1|circle"),
    "an encoding": (("ISO-8859-1", "klingon"), r"no XML|encoding"),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG_X)
def test_a_wrong_pomdpx_file_is_refused_in_one_sentence(tmp_path, what):
    (old, new), message = WRONG_X[what]
    text = corridor()
    assert old in text
    with pytest.raises(HarnessError, match=message) as refused:
        read(tmp_path, text.replace(old, new), "model.pomdpx")
    assert "model.pomdpx" in str(refused.value)


WRONG_DIAGRAM = {
    "an unknown variable": (('var="do"', 'var="did"'), r"'did' is no variable of this function"),
    "an unknown value": (('val="look"', 'val="listen"'), r"'listen' is none of the 2 values of do"),
    "a wildcard": (('val="look"', 'val="*"'), r"an edge needs a value"),
    "an unknown kind": (('type="uniform"', 'type="even"'), r"a SubDAG of type 'even'"),
    "an unknown template": (('idref="keep"', 'idref="kept"'), r"no template 'kept'.*'keep'"),
    "an endless template": (('type="persistent" var="two_1"', 'type="template" idref="keep"'), r"over 200 nodes"),
    "an open end": (("<Terminal>1.0</Terminal>", ""), r"nothing follows"),
    "a number": (("<Terminal>1.0<", "<Terminal>all<"), r"'all' is not a number"),
    "what cannot persist": (("<Parent>two_0 cell_0 do<", "<Parent>one_0 cell_0 do<"), r"two_0|can persist only"),
}


@pytest.mark.parametrize("what", WRONG_DIAGRAM)
def test_a_wrong_diagram_is_refused_in_one_sentence(tmp_path, what):
    (old, new), message = WRONG_DIAGRAM[what]
    assert old in DIAGRAM
    with pytest.raises(HarnessError, match=message):
        read(tmp_path, corridor(DIAGRAM.replace(old, new)), "model.pomdpx")


def test_too_deep_a_file_is_refused(tmp_path):
    with pytest.raises(HarnessError, match="over 500 elements within each other"):
        read(tmp_path, "<pomdpx>" + "<Description>" * 1000, "model.pomdpx")


def test_a_file_that_unpacks_to_more_than_the_limit_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "LARGEST_TEXT", 10**5)
    path = tmp_path / "bomb.pomdp.gz"
    path.write_bytes(gzip.compress(b" " * 10**7))
    with pytest.raises(HarnessError, match=r"bomb\.pomdp\.gz.*100,000 are the most"):
        harness.load(path)
    path.write_bytes(path.read_bytes()[:50])
    with pytest.raises(HarnessError, match="no whole gzip file"):
        harness.load(path)


def test_uniform_over_more_states_than_the_tables_hold_is_refused(tmp_path):
    text = "discount: 0.9\nstates: 30000\nactions: 2\nobservations: 2\nT: * uniform\nO: * uniform\nR: 0 : 0 : 0 : 0 1\n"
    with pytest.raises(HarnessError, match="are too many"):
        read(tmp_path, text)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(HarnessError, match="no such file"):
        harness.load(tmp_path / "model.pomdpx")


def test_arrays_make_the_domain_that_the_file_does(tmp_path):
    d = read(tmp_path, TIGER)
    listen, door = np.array([[0.85, 0.15], [0.15, 0.85]]), np.full((2, 2), 0.5)
    made = harness.from_arrays(
        [np.eye(2), door, door], [listen, door, door], [[-1, -1], [-100, 10], [10, -100]], [0.5, 0.5], 0.95,
        states=["left", "right"], actions=d.actions, observations=d.observations,
    )  # fmt: skip
    assert made.model_hash == d.model_hash
    paid = np.zeros((3, 2, 2, 2)) + np.array([[-1, -1], [-100, 10], [10, -100]])[:, :, None, None]
    again = harness.from_arrays([np.eye(2), door, door], [listen, door, door], paid, [0.5, 0.5], 0.95)
    _assert_same_arrays(again, made)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"T": np.eye(2)}, "T has the axes"),
        ({"O": np.ones((1, 3, 1))}, "O has the shape"),
        ({"b0": [1, 0, 0]}, "b0 has the shape"),
        ({"R": [[1, np.nan]]}, "R has entries that are no numbers"),
        ({"R": [["one", "two"]]}, "R is no array of numbers"),
        ({"T": [[[0.5, 0.4], [0, 1]]]}, "model: the probabilities of state at action a0, state s0 sum to 0.9"),
        ({"discount": 0}, "a discount in"),
        ({"actions": ["one", "two"]}, "actions needs 1 different"),
    ],
)
def test_wrong_arrays_are_refused(change, message):
    right = {
        "T": [np.eye(2)],
        "O": np.ones((1, 2, 1)),
        "R": [[1, 2]],
        "b0": [0.5, 0.5],
        "discount": 0.9,
        "name": "model",
    }
    with pytest.raises(HarnessError, match=message):
        harness.from_arrays(**(right | change))


def test_the_command_line_takes_and_writes_model_files(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiger.pomdp").write_text(TIGER)
    assert main(["export", "tiger.pomdp", "--format", "pomdpx"]) == 0
    printed = capsys.readouterr()
    assert "tiger.pomdp.pomdpx" in printed.out
    assert "tiger.pomdp: visible: none; hidden factors: state (2)" in printed.err
    assert harness.load("tiger.pomdp.pomdpx").model_hash == harness.load("tiger.pomdp").model_hash
    assert main(["export", "rocksample-7x8", "--format", "pomdpx", "--out", "rocks.pomdpx"]) == 0
    assert "not in the file: the reading before the first step" in capsys.readouterr().out
    assert main(["export", "--format", "pomdp"]) == 2
    assert main(["export", "tiger.pomdp", "--format", "pomdp", "--out", "tiger.txt"]) == 2
    assert main(["policies", "tiger.pomdp"]) == 0


def test_rocksample_7x8_keeps_its_tables(tmp_path, rocksample):
    harness.write_model(rocksample, tmp_path / "rocks.pomdpx")
    again = harness.load(tmp_path / "rocks.pomdpx")
    lost = {"legal", "start_observation", "prior_observation", "visible_values"}
    for name in set(rocksample.arrays) - lost:
        assert np.array_equal(rocksample.arrays[name], again.arrays[name]), name
    assert again.n_states == rocksample.n_states == 12_545


def test_data_may_not_name_a_model_file(tmp_path):
    with pytest.raises(HarnessError, match="--allow-code"):
        registry.load_from_data(str(tmp_path / "model.pomdpx.gz"))


def test_a_model_file_has_no_julia(tmp_path):
    d = read(tmp_path, TIGER)
    assert engine.choose("auto", d) == "tables"
    with pytest.raises(HarnessError, match="not defined in Julia"):
        engine.choose("julia", d)


@pytest.mark.skipif(shutil.which("pomdpsol") is None, reason="APPL's pomdpsol is not installed")
@pytest.mark.parametrize("name", ["tiger.pomdp", "tiger.pomdpx"])
def test_appl_takes_what_is_written(tmp_path, name):
    harness.write_model(read(tmp_path, TIGER), tmp_path / name)
    command = ["pomdpsol", "--precision", "0.01", "--timeout", "60", "--output", "/dev/null", str(tmp_path / name)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "WARN" not in printed
    rows = [words for line in printed.splitlines() if len(words := line.split()) == 8 and words[0] != "Time"]
    assert [float(word) for word in rows[-1][3:5]] == pytest.approx([19.37, 19.37], abs=0.02)


@pytest.mark.skipif(not FULL, reason="a minute; make test-full")
def test_a_flat_rocksample_of_12_545_states(tmp_path, rocksample):
    harness.write_model(rocksample, tmp_path / "rocks.pomdp")
    d = harness.load(tmp_path / "rocks.pomdp")
    t = d.arrays
    assert (d.n_states, len(t["legal"]), len(t["outcome_cdf"])) == (12_545, 13 * 12_545, 13 * 12_545)
    assert t["prior_marginals"].sum() == 1
    assert (t["prior_marginals"] == 1 / 256).sum() == 256
    reward = rocksample.arrays["outcome_reward"][0]
    assert set(t["outcome_reward"][0]) == set(reward)
