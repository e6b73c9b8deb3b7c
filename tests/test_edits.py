"""Edits of statements and tours, the local search by them, presets, scripts for states, discounted fitness."""

from __future__ import annotations

import itertools
import shutil
from functools import partial

import numpy as np
import pytest

import harness
from harness import HarnessError
from harness.cli import main
from harness.engine import rng
from harness.expectation.programs import expected
from harness.ge import grammar as bnf
from harness.ge import tour
from harness.ge.defaults import grammar_for
from harness.ge.edits import Editor
from harness.ge.homing import home
from harness.ge.initialisation import GROW, tree
from harness.ge.lexicon import Lexicon
from harness.ge.local_search import LocalSearch
from harness.ge.loop import Evaluated
from harness.ge.mapping import derive
from harness.ge.moves import Moves
from harness.ge.operators import Parent
from harness.ge.parameters import Parameters
from harness.ge.presets import PRESETS, preset
from harness.ge.statements import listings, put, shapes
from harness.ge.tour import Stop
from harness.ge.visits import Visits
from harness.ge.vocabulary import Vocabulary
from harness.play import population
from harness.play.evaluation import evaluate
from harness.play.population import Episodes
from harness.policy.program import ProgramPolicy
from harness.program import ProgramError, parse, words_of

LEFT = bnf.parse("<code> ::= <line> | <code> <line>\n<line> ::= a | b | (<code>)\n")
RIGHT = bnf.parse("<p> ::= <code> | loop <code>\n<code> ::= <line> <code> | <line>\n<line> ::= a | b | (<code>)\n")
SMALL = {"population": 20, "generations": 4, "max_init_depth": 15, "local_search_evaluations": 50, "score_episodes": 50}


@pytest.fixture(scope="module")
def rocksample():
    return harness.load("rocksample-7x8")


@pytest.fixture(scope="module")
def bordercross():
    return harness.load("bordercross-7x8")


def individual(grammar, codons):
    codons = np.asarray(codons, dtype=np.int32)
    return Parent(codons, derive(grammar, codons))


def some(grammar, count=50):
    generator = np.random.default_rng(0)
    for depth in range(4, 4 + count):
        codons = np.concatenate(
            [tree(grammar, 0, depth % 12 + 4, GROW, 1000, generator), generator.integers(9, size=3)]
        )
        yield individual(grammar, codons)


@pytest.mark.parametrize("grammar", [LEFT, RIGHT])
class TestStatements:
    def test_the_texts_of_the_items_make_up_the_list(self, grammar):
        known = shapes(grammar)
        for a in some(grammar):
            outermost = listings(known, a)[0]
            texts = [derive(grammar, item, start=outermost.shape.item).phenotype for item in outermost.items]
            assert " ".join(texts) == a.derivation.phenotype.removeprefix("loop ")

    def test_every_list_is_found_and_can_be_put_back_or_turned_round(self, grammar):
        known = shapes(grammar)
        for a in some(grammar):
            lists = listings(known, a)
            assert len(lists) == 1 + a.derivation.phenotype.count("(")
            for each in lists:
                again = put(a.codons, each, each.items)
                assert derive(grammar, again).phenotype == a.derivation.phenotype
                assert again[len(again) - 3 :].tolist() == a.codons[-3:].tolist()  # the unused tail stays
                turned = individual(grammar, put(a.codons, each, each.items[::-1]))
                same = next(one for one in listings(known, turned) if one.begin == each.begin)
                assert [item.tolist() for item in same.items[::-1]] == [item.tolist() for item in each.items]


def test_a_rule_that_is_no_list_of_one_kind_is_none():
    text = "<code> ::= <line> | <code> <line> | <end>\n<line> ::= <line> a | <end>\n<end> ::= <end> b | c\n"
    assert [bnf.parse(text).rules[rule] for rule in shapes(bnf.parse(text))] == []


class TestMoves:
    def test_ways_on_an_open_grid_are_as_long_as_the_manhattan_distance(self, rocksample):
        moves = Moves(rocksample)
        cells = {v: tuple(rocksample.visible_values[v].tolist()) for v in range(rocksample.n_visible - 1)}
        for (u, a), (v, b) in itertools.product(cells.items(), repeat=2):
            path = moves.path(u, v)
            assert len(path) == abs(a[0] - b[0]) + abs(a[1] - b[1])
            for action in path:
                u = moves.leads[u, action]
            assert u == v

    def test_rocks_pay_and_so_do_the_exits(self, rocksample):
        moves, rocks = Moves(rocksample), [(3, 1), (1, 2), (4, 2), (7, 4), (3, 5), (4, 5), (6, 6), (2, 7)]
        names = {index: name for name, index in words_of(rocksample).actions.items()}
        found = {(tuple(rocksample.visible_values[v].tolist()), names[a]) for v, a in moves.pays}
        assert found == {(rock, "sample()") for rock in rocks} | {((7, y), "right()") for y in range(1, 8)}

    def test_two_robots_meet_where_it_pays(self, bordercross):
        moves = Moves(bordercross)
        places = [bordercross.visible_values[pay.place].tolist() for pay in moves.pays]
        assert places == [[row, 6, row, 6] for row in range(1, 8)]
        start = int(moves.starts[0])
        assert min(len(moves.path(start, pay.place)) for pay in moves.pays) == 11  # SPEC, section 2


class TestTours:
    def script(self, domain, text):
        """An individual of the domain's grammar with a text of operations."""
        grammar = grammar_for(domain, None)
        words, shape = words_of(domain), next(iter(shapes(grammar).values()))
        vocabulary = Vocabulary(grammar, words, shape.item, 1000)
        items = [vocabulary.plain[words.actions[line]] for line in text.split()]
        return grammar, vocabulary, items

    def test_what_comes_after_a_new_stop_happens_where_it_did(self, rocksample):
        """Leaving along the row earns 10; a look at a rock off the way, and its sample if it is good, 5 more."""
        way = "right() " * 7
        grammar, vocabulary, items = self.script(rocksample, way)
        moves, words = Moves(rocksample), words_of(rocksample)
        start = int(moves.starts[0])
        stops = tour.read(items, start, moves, vocabulary, lambda: False)
        assert [len(stop.acts) for stop in stops] == [1]  # the last step leaves, which is no move
        look = vocabulary.plain[words.actions["check(3)"]]
        guarded = next(
            each
            for each in vocabulary.guarded[words.actions["sample()"]]
            if vocabulary.meaning(each).registers == {words.checks["3"]}
        )
        rock = next(v for v in range(rocksample.n_visible) if tuple(rocksample.visible_values[v].tolist()) == (4, 2))
        longer = tour.written(tour.inserted(stops, 0, [Stop(rock, None, (look, guarded))]), start, moves, vocabulary)
        texts = [derive(grammar, item, start=1).phenotype for item in longer]
        assert len(texts) == 3 + 2 + 2 + 5 + 1 - 2 + 2
        program = parse("\n".join(texts), words)
        assert harness.exact(rocksample, ProgramPolicy(program)).mean.middle == pytest.approx(15)
        shorter = tour.removed(tour.read(longer, start, moves, vocabulary, lambda: False), 0, 1)
        assert [item.tolist() for item in tour.written(shorter, start, moves, vocabulary)] == [
            i.tolist() for i in items
        ]

    def test_a_guarded_move_counts_as_it_is_taken(self, rocksample):
        _, vocabulary, items = self.script(rocksample, "up() check(1)")
        guarded = vocabulary.guarded[words_of(rocksample).actions["up()"]][0]
        moves = Moves(rocksample)
        places = [
            tour.read([guarded, *items], int(moves.starts[0]), moves, vocabulary, partial(bool, taken))[-1].place
            for taken in (False, True)
        ]
        assert rocksample.visible_values[places].tolist() == [[1, 5], [1, 6]]

    @pytest.mark.parametrize("walks", ["nowhere", "anywhere", "paying"])
    def test_edits_give_programs_and_leave_the_parent_alone(self, rocksample, walks):
        grammar, p = grammar_for(rocksample, None), Parameters(mutation="edits", walks=walks)
        editor, generator = Editor(grammar, rocksample, p), np.random.default_rng(1)
        changed = 0
        for a in some(grammar, 100):
            before = a.codons.tolist()
            text = derive(grammar, editor.edited(a, generator)).phenotype
            parse(text, words_of(rocksample))
            changed += text != a.derivation.phenotype
            assert a.codons.tolist() == before
        assert changed > 50

    def test_a_stop_is_put_where_it_pays(self, bordercross):
        """From one statement, edits alone lead to a meeting within some hundred tries; without walks they do not."""
        met = {}
        for walks in ("nowhere", "paying"):
            grammar, words = grammar_for(bordercross, None), words_of(bordercross)
            editor = Editor(grammar, bordercross, Parameters(mutation="edits", walks=walks))
            a, generator = individual(grammar, [0, 1, 0, 0]), np.random.default_rng(0)
            programs = [parse(derive(grammar, editor.edited(a, generator)).phenotype, words) for _ in range(200)]
            met[walks] = expected(bordercross, programs, 50, 1000).returns.max()
        assert met == pytest.approx({"nowhere": 0, "paying": 500})


class TestVisits:
    @pytest.mark.parametrize(
        ("text", "place"),
        [
            ("while(x() < 3) right() while(x() > 3) left() while(y() < 2) up() while(y() > 2) down()", (3, 2)),
            ("while(x() > 1) left() while(y() < 7) up()", (1, 7)),
            ("if(at(4,4)) up() while(x() > 1) left() while(y() > 1) down()", (1, 1)),
            ("while(x() < 3) right() while(x() > 3) left()", None),  # of any row
            ("while(x() < 8) right()", None),  # the episode ends
            ("right() while(x() > 1) left() while(y() > 1) down()", None),  # from (7,1) it does too
            ('while(x() > 1) left() while(y() > 1) down() if(3 == "bad") up()', None),  # who knows
            ("while(x() > 1) left() while(y() > 1) down() check(3)", None),  # more than a way
        ],
    )
    def test_the_statements_that_lead_to_one_place_from_anywhere(self, rocksample, text, place):
        moves = Moves(rocksample)
        found = home(parse(text, words_of(rocksample)), moves, moves.reached(int(moves.starts[0])))
        assert (None if found < 0 else tuple(rocksample.visible_values[found].tolist())) == place

    def test_every_cell_has_one_in_the_grammar_with_feedback(self, rocksample):
        visits, shape = self.made(rocksample)
        cells = [tuple(rocksample.visible_values[place].tolist()) for place in visits.homing(shape).ways]
        assert sorted(cells) == sorted(itertools.product(range(1, 8), repeat=2))

    def test_a_look_at_a_rock_is_among_the_visits(self, rocksample):
        """Leaving earns 10; going to a rock first, to sample it if it is good, 5 more at most (SPEC, section 1)."""
        visits, shape = self.made(rocksample)
        generator, words = np.random.default_rng(2), words_of(rocksample)
        texts = {
            " ".join(
                derive(visits.lexicon.grammar, item, start=shape.item).phenotype
                for item in visits.visit(shape, generator)
            )
            for _ in range(300)
        }
        programs = [parse(f"{text} while(x() < 8) right()", words) for text in texts]
        returns = expected(rocksample, programs, 50, 1000).returns
        assert 14.9 < returns.max() <= 15 + 1e-9

    def test_a_visit_made_anew_leads_to_the_same_place(self, rocksample):
        visits, shape = self.made(rocksample)
        generator, changed = np.random.default_rng(3), 0

        def text(items):
            return " ".join(derive(visits.lexicon.grammar, item, start=shape.item).phenotype for item in items)

        ways = {text([way]) for way in visits.homing(shape).ways.values()}
        for _ in range(100):
            visit = visits.visit(shape, generator)
            new = visits.anew(shape, visit, generator)
            found = {way for way in ways if way in text(visit)}
            if len(found) == 1:  # a condition's other block may lead elsewhere
                assert found.pop() in text(new)
                changed += text(new) != text(visit)
        assert changed > 20

    def test_lists_are_taken_apart_between_visits(self, rocksample):
        visits, shape = self.made(rocksample)
        way, look = next(iter(visits.homing(shape).ways.values())), visits.lexicon.frames(shape)[0]
        check = next(iter(visits.lexicon.vocabulary(shape).plain.values()))
        items = [look, way, check, look, look, check, way, look]
        parts = visits.parts(shape, items)
        assert [len(part) for part in parts] == [1, 4, 3]
        assert [id(item) for part in parts for item in part] == [id(item) for item in items]

    def made(self, domain):
        grammar = grammar_for(domain, "rocksample-feedback")
        lexicon = Lexicon(grammar, words_of(domain), 1000)
        return Visits(lexicon, Moves(domain), paying=True), next(iter(lexicon.shapes.values()))


def test_the_end_of_a_block_moves_and_nothing_else(rocksample):
    grammar = grammar_for(rocksample, "rocksample-feedback")
    editor, generator, moved = Editor(grammar, rocksample, Parameters()), np.random.default_rng(0), 0
    for a in some(grammar, 60):
        listing = listings(shapes(grammar), a)[0]
        items = editor._stretched(listing, generator)
        before, after = (derive(grammar, put(a.codons, listing, each)).phenotype for each in (listing.items, items))
        moved += before != after
        without = str.maketrans("", "", "{} ")
        assert sorted(before) == sorted(after)
        if "else" not in before:  # of what stands before an else, the end goes behind all of it
            assert before.translate(without) == after.translate(without)
        parse(after, words_of(rocksample))
    assert moved > 5


def letters(texts, generation):
    """More a's are better; every evaluation costs one."""
    fitness = np.array([text.count("a") - 2 * text.count("b") for text in texts], dtype=float)
    return Evaluated(fitness, len(set(fitness)), len(texts))


class TestLocalSearch:
    def climbed(self, rocksample, evaluations, generation=3):
        p = Parameters(local_search=1, local_search_evaluations=evaluations, max_codons=30)
        search = LocalSearch(Editor(LEFT, rocksample, p), letters, p)
        a = individual(LEFT, [0, 1])
        return search([a, a], generation)

    def test_it_climbs_and_passes_on_what_it_found(self, rocksample):
        (learnt, twin), cost = self.climbed(rocksample, 500)
        assert derive(LEFT, learnt.codons).phenotype == learnt.phenotype == twin.phenotype
        assert letters([learnt.phenotype], 0).fitness[0] >= 5  # from −2
        assert len(learnt.codons) <= 30
        assert 100 < cost <= 501

    def test_the_same_generation_gives_the_same(self, rocksample):
        assert self.climbed(rocksample, 100)[0][0].phenotype == self.climbed(rocksample, 100)[0][0].phenotype
        assert self.climbed(rocksample, 25)[1] <= 26

    def test_one_evaluation_less_than_a_batch_is_a_batch(self, rocksample):
        assert self.climbed(rocksample, 1)[1] == self.climbed(rocksample, 25)[1]


class TestRuns:
    def test_best_goes_on_bit_for_bit_after_an_interruption(self, tmp_path):
        options = {**SMALL, "seed": 5, "preset": "best"}
        whole = harness.evolve("rocksample-7x8", out=tmp_path / "whole", **options)
        harness.evolve("rocksample-7x8", out=tmp_path / "part", **{**options, "generations": 2})
        for name in ("best.json", "finalists.csv"):
            (tmp_path / "part" / name).unlink()
        rest = harness.resume(tmp_path / "part", generations=4, workers=2)
        columns = [name for name in whole.history if name != "seconds"]
        assert whole.history[columns].equals(rest.history[columns])
        assert whole.best.text == rest.best.text
        shutil.rmtree(tmp_path / "part")

    def test_it_finds_the_shortest_crossing(self, bordercross):
        found = harness.evolve(bordercross, preset="best", generations=6, seed=77, score_episodes=20)
        assert found.best.score.mean == 500
        assert found.best.program.length <= 14  # 12 is the least; the paper's parameters seldom cross at all

    def test_presets_come_before_what_is_given(self):
        found = harness.evolve("rocksample-7x8", preset="best", **{**SMALL, "generations": 0, "elites": 3})
        assert (found.parameters.elites, found.parameters.mutation) == (3, "edits")
        assert Parameters(**preset("paper")) == Parameters()

    def test_an_unknown_preset_is_named(self):
        with pytest.raises(HarnessError, match=r"no preset 'bset'.*best"):
            harness.evolve("rocksample-7x8", preset="bset")

    def test_the_command_line_takes_a_preset(self, tmp_path, capsys):
        out = tmp_path / "run"
        options = [f"--{name.replace('_', '-')}={value}" for name, value in SMALL.items()]
        assert main(["evolve", "bordercross-7x8", "--preset", "best", "--out", str(out), *options]) == 0
        assert 'mutation = "edits"' in (out / "parameters.toml").read_text()
        assert main(["evolve", "bordercross-7x8", "--preset", "beat", "--out", str(out), *options]) == 2
        assert "no preset 'beat'" in capsys.readouterr().err

    def test_every_preset_is_a_set_of_parameters(self):
        for name in PRESETS:
            Parameters(**preset(name))

    def test_walks_need_edits(self):
        with pytest.raises(HarnessError, match="walks are taken by edits"):
            Parameters(walks="paying")


class TestDiscounted:
    TEXT = 'check(3)\nif(3 == "good") up()\nright()\nsample()\nright()'

    def test_played_and_expected_returns_are_discounted_as_elsewhere(self, rocksample):
        program = parse(self.TEXT + "\nright()" * 8, words_of(rocksample))
        seed = rng.TRAINING + 3
        played = population.play(rocksample, [program], Episodes(seed, 0, 200, 50), discount=rocksample.discount)
        score = evaluate(rocksample, ProgramPolicy(program), episodes=200, seed=seed).score
        assert played.returns.mean() == pytest.approx(score.discounted_mean, abs=1e-12)
        found = expected(rocksample, [program], 50, 1000, discount=rocksample.discount)
        assert found.returns[0] == pytest.approx(harness.exact(rocksample, ProgramPolicy(program)).discounted.middle)

    @pytest.mark.parametrize("fitness", ["sampled", "exact"])
    def test_an_evolution_selects_by_it(self, fitness):
        found = harness.evolve("rocksample-7x8", preset="best", **SMALL, fitness=fitness, objective="discounted")
        exact = harness.exact("rocksample-7x8", found.best.policy).discounted.middle
        assert found.best.validation == pytest.approx(exact, abs=2)
        assert found.history["test"].iloc[-1] == pytest.approx(exact, abs=2)
        assert exact < 0.8 * found.best.score.mean  # so neither is the undiscounted return


class TestPlaces:
    def test_a_program_asks_where_it_is(self, rocksample):
        words = words_of(rocksample)
        one, other = (
            parse(f"loop if({a}) {{ up() right() }} if(not {a}) right()", words)
            for a in ("at(1,4)", "(x() == 1 and y() == 4)")
        )
        assert parse(one.text, words).text == one.text
        assert "if(at(1,4)) {" in one.text
        a, b = (harness.exact(rocksample, ProgramPolicy(program)) for program in (one, other))
        assert a.mean == b.mean == (10, 10)
        assert expected(rocksample, [one], 50, 100).returns[0] == 10

    @pytest.mark.parametrize(("text", "why"), [("at(9,9)", "no place"), ("if(at(9,9)) up()", r"no place .*at\(1,1\)")])
    def test_a_place_that_is_none_is_refused(self, rocksample, text, why):
        with pytest.raises(ProgramError, match=why):
            parse(text, words_of(rocksample))

    def test_the_end_is_no_place(self, rocksample):
        assert len(words_of(rocksample).places) == 49

    def test_a_script_for_each_state(self, rocksample):
        grammar = grammar_for(rocksample, "states")
        text = derive(grammar, np.zeros(500, dtype=np.int32)).phenotype
        program = parse(text, words_of(rocksample))
        assert program.loop
        assert text.count("at(") == 49

    def test_too_many_states_are_refused(self, bordercross):
        with pytest.raises(HarnessError, match=r"1,7.. named visible values"):
            grammar_for(bordercross, "states")
