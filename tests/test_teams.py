"""Domains with agents (Dec-POMDPs) and teams: each member acts by its own readings, whatever the others read."""

from __future__ import annotations

import itertools
import json
import pickle
from dataclasses import replace

import numpy as np
import pytest

import harness
from harness.engine import rng
from harness.engine.batch import Batch
from harness.errors import HarnessError, PolicyError, SnapshotError
from harness.model import archive, domain, validation
from harness.model.agents import GOING, OVER, local_view, own_observations
from harness.play.conformance import check_policy
from harness.play.evaluation import evaluate
from harness.play.population import Episodes, play
from harness.policy import make
from harness.policy.base import constant
from harness.policy.converting import controller_of
from harness.policy.fsc import FileController
from harness.policy.program import ProgramPolicy
from harness.policy.team import policy_of
from harness.program import ProgramError, parse, words_of
from harness.solver import solution

FIXED, HIDDEN = "dec-bordercross-7x8", "dec-bordercross-7x8-random"
MOVES = ["up", "right", "down", "left", "cooperate"]
CROSSING = """\
agent(1):
right() right() right() right() right() cooperate() cooperate()
agent(2):
up() up() up() right() right() right() cooperate()
"""
TEXTS = [
    CROSSING,
    "agent(1): loop if(distance() < 3) right() else cooperate() agent(2): loop if(distance() > 2) right() else up()",
    "agent(1): while(distance() > 1) right() down() agent(2): right() right() cooperate() cooperate() cooperate()",
    "agent(1): loop cooperate() agent(2): if(distance() == '3') down() if(distance() == 4) up() right()",
]


@pytest.fixture(scope="module")
def team():
    return harness.load(FIXED)


@pytest.fixture(scope="module")
def hidden_team():
    return harness.load(HIDDEN)


class Always:
    """Takes the same action always."""

    memory = ()

    def __init__(self, action):
        self.action = action

    def reset(self, batch):
        pass

    def act(self, batch):
        return constant(batch.size, self.action)


class Watching:
    """Waits, and writes down all that it is shown."""

    def __init__(self):
        self.seen = []

    def clone(self):  # what is seen goes to the original
        made = Watching()
        made.seen = self.seen
        return made

    def reset(self, batch):
        self.act(batch)

    def act(self, batch):
        fields = {name: value for name, value in vars(batch).items() if name not in ("_draw", "domain")}
        self.seen.append((batch.domain, {name: np.array(value) for name, value in fields.items()}, batch.uniform()))
        return constant(batch.size, 4)


def a_batch(d, observation, visible, seed=3):
    n = len(observation)
    marginals = np.random.default_rng(visible).random((n, d.n_marginals))
    return Batch(
        d, np.full(n, visible, np.int32), np.array(observation, np.int32), marginals, np.zeros(n, bool), seed, 0
    )


class TestAgents:
    def test_joint_names_are_combinations_of_their_own(self, hidden_team):
        d = hidden_team
        assert [agent.name for agent in d.agents] == ["robot 1", "robot 2"]
        assert all(agent.actions == tuple(f"{move}()" for move in MOVES) for agent in d.agents)
        assert d.actions == tuple(f"{one}-{two}()" for one in MOVES for two in MOVES)
        own = own_observations(d, np.arange(d.n_observations, dtype=np.int32))
        named = zip(
            *([agent.observations[o] for o in row] for agent, row in zip(d.agents, own, strict=True)), strict=True
        )
        assert tuple(map(" ".join, named)) == d.observations
        assert own_observations(d, np.array([-1], np.int32)).tolist() == [[-1], [-1]]

    def test_what_an_agent_sees_is_words_and_nothing_else(self, hidden_team):
        view = local_view(hidden_team, 1)
        assert not list(validation.breaches(view))
        assert view.n_visible == 2
        assert view.tables.terminal.tolist() == [False, True]
        assert (GOING, OVER) == (0, 1)
        assert not view.factors
        assert not view.agents
        assert not view.features
        assert words_of(view).reading == "distance()"
        assert view.model_hash != hidden_team.model_hash
        assert not any(
            np.shares_memory(mine, all_) for mine in view.arrays.values() for all_ in hidden_team.arrays.values()
        )

    def test_they_survive_a_snapshot(self, hidden_team, tmp_path):
        domain.save(hidden_team, tmp_path / "team.npz")
        assert harness.load(tmp_path / "team.npz") == hidden_team
        assert harness.load(tmp_path / "team.npz").agents == hidden_team.agents

    def test_they_are_part_of_the_model_and_their_absence_is_not(self, hidden_team):
        assert replace(hidden_team, agents=()).model_hash != hidden_team.model_hash
        stored = json.loads(harness.registry.program_path("bordercross-7x8", "ge").read_text())["model_hash"]
        assert harness.load("bordercross-7x8").model_hash == stored  # of a file from before there were agents

    @pytest.mark.parametrize(
        ("agents", "words"),
        [
            ("one", "agents is no list"),
            ([["robot 1", ["up()"], []]], "agents is no list"),
            ([["a", ["x", "y"], ["0"]]], "25 actions are not the 2 combinations"),
            ([["a", ["x"] * 25, [str(i) for i in range(100)]]], "share a name"),
            ([["a", list("abcde"), list("0123456789")]] * 2, "two agents share a name"),
        ],
    )
    def test_agents_that_do_not_fit_are_refused(self, hidden_team, tmp_path, agents, words):
        record = {**domain.to_record(hidden_team), "agents": agents}
        archive.write(tmp_path / "bad.npz", domain.KIND, record, hidden_team.arrays)
        with pytest.raises(SnapshotError, match=words):
            harness.load(tmp_path / "bad.npz")


class TestIsolation:
    def test_a_member_sees_the_same_whatever_the_others_read(self, hidden_team):
        """Two batches that differ in all that robot 1 must not see: robot 2's readings, the cells, the belief."""
        shown = []
        for other, visible in (([0, 3, 9], 5), ([7, 7, 1], 17)):
            watching = Watching()
            team = harness.TeamPolicy(hidden_team, [watching, Always(0)])
            batch = a_batch(
                hidden_team, [10 * mine + theirs for mine, theirs in zip([2, 4, 0], other, strict=True)], visible
            )
            team.reset(batch)
            team.act(batch)
            shown.append(watching.seen)
        for (one, fields, drawn), (two, others, drawn_too) in zip(*shown, strict=True):
            assert one is two is local_view(hidden_team, 0)
            assert fields.keys() == others.keys() == {"visible", "observation", "marginals", "done", "step"}
            assert all(np.array_equal(fields[name], others[name]) for name in fields)
            assert fields["observation"].tolist() == [2, 4, 0]
            assert fields["marginals"].size == 0
            assert np.array_equal(drawn, drawn_too)

    def test_nor_can_it_write_what_others_see(self, hidden_team):
        class Writing(Always):
            def act(self, batch):
                batch.observation[:] = 0

        team = harness.TeamPolicy(hidden_team, [Writing(0), Always(0)])
        with pytest.raises(ValueError, match="read-only"):
            evaluate(hidden_team, team, episodes=3, engine="tables")

    def test_its_actions_hang_on_its_own_readings_alone(self, hidden_team):
        """Robot 1's actions in episodes grouped by robot 1's own readings so far: one sequence a group."""
        program = (
            "agent(1): loop if(distance() > 3) right() else down() agent(2): loop if(distance() > 4) right() else up()"
        )
        policy = policy_of(parse(program, words_of(hidden_team)))
        records, read = [], []
        for record in harness.play.evaluation.simulate(hidden_team, policy, "tables", 0, 0, 3000, 3):
            if record.actions is not None:
                records.append(record.actions // len(MOVES))
            read.append(own_observations(hidden_team, record.batch.observation)[0])
        keys = [tuple(row) for row in np.array(read[:3]).T.tolist()]
        taken = {}
        for key, acts in zip(keys, np.array(records).T.tolist(), strict=True):
            assert taken.setdefault(key, acts) == acts
        assert len(taken) > 10

    def test_random_members_draw_by_themselves_and_alike_in_any_batch(self, team):
        policy = make("team:random,random", team)[1]
        batch = a_batch(team, [0] * 4000, 0)
        policy.reset(batch)
        one, two = np.divmod(policy.act(batch), len(MOVES))
        assert abs(np.mean(one == two) - 1 / 5) < 5 * np.sqrt(0.16 / 4000)
        check_policy("team:random,random", team, episodes=60, horizon=10)


class TestPlay:
    def test_the_joint_action_is_made_of_their_own(self, team):
        for one, two in itertools.product(range(5), repeat=2):
            policy = harness.TeamPolicy(team, [Always(one), Always(two)])
            batch = a_batch(team, [0], 0)
            policy.reset(batch)
            assert team.actions[policy.act(batch)[0]] == f"{MOVES[one]}-{MOVES[two]}()"

    def test_when_one_stops_all_do(self, team):
        for members in ([Always(-1), Always(2)], [Always(2), Always(-1)]):
            assert evaluate(team, harness.TeamPolicy(team, members), episodes=2, engine="tables").steps.tolist() == [
                0,
                0,
            ]

    def test_the_shortest_crossing_is_a_closed_form_and_brute_force(self, team):
        """Breadth first over the tables: nothing is hidden, so no policy of any kind is quicker."""
        t, layer, steps = team.arrays, {int(team.arrays["start_visible"][0])}, 0
        while not (reached := {v for v in layer if t["terminal"][v]}):
            rows = [t["first_row"][v * 25 + a] for v in layer for a in range(25)]
            layer, steps = {int(t["outcome_visible"][t["row_outcomes"][row]]) for row in rows}, steps + 1
        assert reached
        assert steps == 7
        best = 500 * 0.95**6
        for found in (harness.exact(team, policy_of(parse(CROSSING, words_of(team)))), harness.exact(team, "solved")):
            assert found.is_exact
            assert found.mean.low == pytest.approx(500, abs=1e-6)
            assert found.discounted.low == pytest.approx(best, abs=1e-6)
        stored = solution.read(harness.registry.policy_path(FIXED, "solved"), team, solution.GRAPH_KIND).record
        assert stored["lower"] - 1e-6 <= best <= stored["upper"] + 1e-6

    @pytest.mark.parametrize("name", [FIXED, HIDDEN])
    @pytest.mark.parametrize("shaping", ["none", "potential"])
    def test_compiled_play_is_the_same_bit_for_bit(self, name, shaping):
        d = harness.load(name).shaped(shaping)
        programs = [parse(text, words_of(d)) for text in TEXTS]
        played = play(d, programs, Episodes(5, 7, 400, 20), discount=1.0)
        discounted = play(d, programs, Episodes(5, 7, 400, 20), discount=d.discount)
        for p, program in enumerate(programs):
            slow = evaluate(d, policy_of(program), episodes=400, seed=5, first=7, horizon=20, engine="tables")
            assert np.array_equal(played.returns[p], slow.returns)
            assert np.array_equal(discounted.returns[p], slow.discounted)
            assert played.steps[p] == slow.steps.sum()
        assert len(np.unique(played.returns)) > (10 if name == HIDDEN else 2)  # readings of known cells vary little

    def test_programs_of_one_controller_and_of_agents_do_not_mix(self, team):
        words = words_of(team)
        joint = parse("loop right-right()", words)
        with pytest.raises(PolicyError, match="all a section for each agent"):
            play(team, [joint, parse(CROSSING, words)], Episodes(0, 0, 2, 5))
        # robot 2 is at the wall after three moves
        assert play(team, [joint], Episodes(0, 0, 2, 5)).returns.tolist() == [[-200, -200]]

    def test_expected_returns_are_those_of_many_episodes(self, hidden_team):
        for text in TEXTS[1:]:
            policy = policy_of(parse(text, words_of(hidden_team)))
            exact = harness.exact(hidden_team, policy, horizon=15)
            score = evaluate(hidden_team, policy, episodes=20_000, horizon=15, engine="tables").score
            assert exact.is_exact
            assert abs(exact.mean.low - score.mean) < 5 * score.sem + 1e-9
            assert abs(exact.discounted.low - score.discounted_mean) < 5 * score.discounted_sem + 1e-9

    def test_expected_returns_of_a_random_member_are_refused(self, team):
        with pytest.raises(PolicyError, match="random numbers"):
            harness.exact(team, "team:random,random")

    def test_a_team_is_copied_and_pickled(self, hidden_team):
        policy = policy_of(parse(TEXTS[1], words_of(hidden_team)))
        there = pickle.loads(pickle.dumps(policy))
        returns = [evaluate(hidden_team, each, episodes=50, engine="tables").returns for each in (policy, there)]
        assert np.array_equal(*returns)
        check_policy(policy, hidden_team, episodes=60, horizon=12)


class TestSpec:
    @pytest.fixture
    def files(self, tmp_path):
        (tmp_path / "one.txt").write_text(CROSSING.splitlines()[1])
        walk = ["up()", "up()", "up()", "right()", "right()", "right()", "cooperate()"]
        nodes = {str(i): [{"do": do, "go": str(min(i + 1, 6))}] for i, do in enumerate(walk)}
        (tmp_path / "two.json").write_text(json.dumps({"start": "0", "nodes": nodes}))
        return tmp_path

    def test_scripts_and_controllers_play_together(self, team, files):
        spec = f"team:program:{files}/one.txt,fsc:{files}/two.json"
        score = evaluate(team, spec, episodes=20, engine="tables").score
        assert (score.mean, score.steps_mean) == (500, 7)
        table = harness.compare(team, [spec], exact=True, episodes=10)
        assert table["discounted_mean"][0] == pytest.approx(500 * 0.95**6)
        assert "right-up()" in "".join(harness.replay(team, spec, engine="tables"))

    @pytest.mark.parametrize(
        ("spec", "words"),
        [
            ("team:random", "a policy for each of robot 1, robot 2"),
            ("team:random,random,random", "a policy for each of robot 1, robot 2"),
            ("team:random,solved", "no agent of a team can play 'solved'"),
            ("team:nobody,random", "no agent of a team can play 'nobody'"),
        ],
    )
    def test_what_no_team_is_is_said(self, team, spec, words):
        with pytest.raises(PolicyError, match=words):
            make(spec, team)

    def test_teams_are_for_domains_with_agents(self, bordercross, team):
        with pytest.raises(PolicyError, match="needs a domain with agents"):
            make("team:random,random", bordercross)
        with pytest.raises(PolicyError, match="has no agents"):
            harness.TeamPolicy(bordercross, [Always(0)])
        with pytest.raises(PolicyError, match="one for each of robot 1, robot 2"):
            harness.TeamPolicy(team, [Always(0)])
        with pytest.raises(PolicyError, match="has no agents"):
            evaluate(bordercross, harness.TeamPolicy(team, [Always(0), Always(0)]), episodes=2, engine="tables")

    def test_one_is_kept_where_there_are_agents(self, team):
        with pytest.raises(PolicyError, match="no team is kept for mine"):
            make("team", replace(team, name="mine"))

    def test_data_names_no_files_of_a_team(self, team):
        with pytest.raises(HarnessError, match="allow-code"):
            harness.policy.check_from_data("team:program:a.txt,program:b.txt")

    def test_a_member_s_wrong_action_is_named(self, team):
        with pytest.raises(PolicyError, match="act\\(\\) returned action 7; robot 2 of dec-bordercross-7x8"):
            evaluate(team, harness.TeamPolicy(team, [Always(0), Always(7)]), episodes=2, engine="tables")


class TestLanguage:
    def test_a_text_is_printed_and_read_again(self, team):
        words = words_of(team)
        for text in TEXTS:
            program = parse(text, words)
            again = parse(program.text, words)
            assert again.text == program.text
            assert [part.code.tolist() for part in again.parts] == [part.code.tolist() for part in program.parts]
            assert program.length == sum(part.length for part in program.parts)
        assert parse(CROSSING, words).text.startswith("agent(1):\nright()\n")

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("agent(1): up()", "a program for each agent, in order: agent\\(1\\): … agent\\(2\\): …"),
            ("agent(2): up() agent(1): up()", "in order"),
            ("up() agent(1): up() agent(2): up()", "in order"),
            (
                "# agent(3):\nagent(1):\nup()\nagent(2):\n  up(2)",
                "line 5, column 3: robot 2 of .* knows no operation 'up\\(2\\)'",
            ),
            ("agent(1): up() agent(2):", "line 1, column 25: the program has no statement"),
            ("agent(1): up-up() agent(2): up()", "line 1, column 11: robot 1 of .* knows no operation"),
        ],
    )
    def test_errors_name_the_place(self, team, text, words):
        with pytest.raises(ProgramError, match=words):
            parse(text, words_of(team))

    def test_several_controllers_are_not_one(self, team):
        program = parse(CROSSING, words_of(team))
        with pytest.raises(PolicyError, match="take one section"):
            controller_of(program, team)
        with pytest.raises(PolicyError, match="played by a team"):
            ProgramPolicy(program)
        one = controller_of(program.parts[0], local_view(team, 0))  # but each is one by itself
        two = controller_of(program.parts[1], local_view(team, 1))
        members = [FileController(local_view(team, i), nodes) for i, nodes in enumerate((one, two))]
        assert harness.exact(team, harness.TeamPolicy(team, members)).mean.low == pytest.approx(500)

    def test_elsewhere_there_are_no_sections(self, bordercross):
        with pytest.raises(ProgramError, match="':' cannot stand here"):
            parse("agent(1): up(1)", words_of(bordercross))

    def test_agents_of_different_words_have_rules_of_their_own(self, team):
        first, second = team.agents
        other = replace(team, agents=(first, second._replace(actions=("a()", "b()", "c()", "d()", "e()"))))
        text = harness.grammar(other, feedback=True)
        assert "<op-1>        ::= up() | right() | down() | left() | cooperate()" in text
        assert "<op-2>        ::= a() | b() | c() | d() | e()" in text
        assert "'agent(1): '<program-1>' agent(2): '<program-2>" in text
        assert harness.grammar(team).count("::= up()") == 1


SMALL = {
    "population": 20, "generations": 3, "episodes": 10, "max_init_depth": 14, "score_episodes": 50,
    "test_episodes": 20, "validation_episodes": 20, "shaping": "potential",
}  # fmt: skip


class TestEvolution:
    def test_the_winner_is_a_team_everywhere(self, hidden_team):
        best = harness.evolve(hidden_team, **SMALL).best
        assert best.text.startswith("agent(1):")
        assert len(best.program.parts) == 2
        played = evaluate(hidden_team, best.policy, episodes=50, seed=rng.HELD_OUT, engine="tables")
        assert played.score == best.score
        assert harness.compare(hidden_team, [best.policy], episodes=5, engine="tables")["policy"].tolist() == [
            "program"
        ]

    @pytest.mark.parametrize("fitness", ["auto", "exact"])
    def test_expected_fitness_of_teams(self, team, fitness):
        small = {**SMALL, "population": 6, "generations": 1, "horizon": 8}
        best = harness.evolve(team, fitness=fitness, **small).best
        assert len(best.program.parts) == 2

    def test_a_team_is_simplified(self, team):
        text = CROSSING.replace("agent(2):\n", "agent(2):\nif(distance() < 0) down()\n")
        found = harness.simplify(team, text, episodes=50)
        assert found.program.text == parse(CROSSING, words_of(team)).text
        assert found.after == found.before == 500
