"""Hybrid evolution: constants written back into codons, learning in the loop, runs that learn."""

from __future__ import annotations

import itertools
import signal
import subprocess
import sys
import time

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import harness
from harness.cli import main
from harness.engine import rng
from harness.expectation.smooth.forward import forward
from harness.ge import grammar as bnf
from harness.ge import loop, refinement, search
from harness.ge.defaults import grammar_for
from harness.ge.fitness import ProgramFitness
from harness.ge.folder import RunFolder
from harness.ge.initialisation import GROW, tree
from harness.ge.mapping import derive
from harness.ge.operators import Parent
from harness.ge.parameters import Parameters
from harness.ge.refinement import Refiner, rivals
from harness.ge.spelling import Speller, nodes
from harness.play import population
from harness.play.population import Episodes
from harness.program import constant_spans, parse, words_of
from tests.conftest import size
from tests.test_evolution import LISTS, count, letters, results, same

HEAD = "<code> ::= <line> | <code> <line>\n<line> ::= check(3) | if(<test>) <op>\n<op> ::= up() | sample()\n"
GRAMMARS = {
    "rocksample": None,
    "rocksample-feedback": None,
    "rocksample-const": None,
    "digits in the test": HEAD + "<test> ::= belief(3) > 0.<d><d> | <d> == '\"good\"'\n<d> ::= 1 | 2 | 5 | 8\n",
    "a list of numbers": HEAD + "<test> ::= belief(3) '<' <c>\n<c> ::= 0.5 | 0.75 | 1 | 0.125 | 0.5\n",
    "any number of digits": HEAD + "<test> ::= belief(<d>) > 0.<n>\n<n> ::= <d> | <d><n>\n<d> ::= 1 | 4 | 7\n",
    "chains": HEAD + "<test> ::= <b> > <value> and <b> > 0.25\n<b> ::= belief(1)\n<value> ::= <c> | 0<e>\n"
    "<c> ::= 0<e>\n<e> ::= .<d><d>\n<d> ::= 0 | 3 | 6 | 9\n",
}
LOOK = """
<code> ::= <line> | <code> <line>
<line> ::= check(2) | <second> | right() | check(2) if(belief(2) > <c>) check(3) | right() right() right() right()
<second> ::= check(2) down() down() if(belief(2) > <c>) sample() up() up() | check(5) if(belief(5) > <c>) right()
<c> ::= 0.<d><d> | 0.0<d> | 0.99 | 0.98
<d> ::= 0 | 2 | 9
"""  # programs whose constants matter: rock 2 lies two steps below the start, where a reading is right with 0.967
IMPROVED = {"tournament": 5, "crossover": "subtree", "mutation": "subtree", "mutation_probability": 0.5}
SMALL = {
    "population": 30, "generations": 8, "episodes": 20, "max_init_depth": 20, "score_episodes": 200, "refine": 3,
    "refine_episodes": 30, **IMPROVED,
}  # fmt: skip


def named(name):
    text = GRAMMARS[name]
    return grammar_for(harness.load("rocksample-7x8"), name) if text is None else bnf.parse(text, name)


def sentence(grammar, seed, codon_size=1000):
    codons = tree(grammar, 0, 22, GROW, codon_size, np.random.default_rng(seed))
    return codons, derive(grammar, codons)


@pytest.fixture(scope="module")
def words(rocksample):
    return words_of(rocksample)


seeds = st.integers(0, 2**32)
grammars = st.sampled_from(sorted(GRAMMARS))


class TestWriteBack:
    @settings(max_examples=200, deadline=None)
    @given(name=grammars, seed=seeds, values=st.lists(st.floats(0, 1), min_size=60, max_size=60))
    def test_the_program_with_the_new_constants_and_nothing_else(self, words, name, seed, values):
        """Genotype, write-back, mapping: the text between the constants stays, and the codons that spell it."""
        grammar = named(name)
        codons, derivation = sentence(grammar, seed)
        text, speller = derivation.phenotype, Speller(grammar, 1000)
        spans = constant_spans(text, words)
        places = speller.places(codons, spans)
        new = [value for value, _ in zip(values, spans, strict=False)]
        written = speller.write(codons, places, new)
        after = derive(grammar, written).phenotype
        assert ((written >= 0) & (written < 1000)).all()
        own = parse(text, words)
        wanted = [
            value if place is None else place.values[np.abs(place.values - x).argmin()]
            for value, place, x in zip(own.constants, places, new, strict=True)
        ]
        assert parse(after, words).text == own.with_constants(np.array(wanted)).text
        between = [text[a:b] for a, b in zip([0, *(e for _, e in spans)], [*(s for s, _ in spans), None], strict=True)]
        ends = constant_spans(after, words)
        assert between == [
            after[a:b] for a, b in zip([0, *(e for _, e in ends)], [*(s for s, _ in ends), None], strict=True)
        ]
        slots = sorted((slot.first, slot.last) for place in places if place for slot in place.slots)
        kept = np.delete(codons, [i for first, last in slots for i in range(first, last)])
        assert len(kept) == len(codons) - sum(last - first for first, last in slots)
        position = 0  # the codons outside the slots stand there still, in order
        for codon in kept.tolist():
            while written[position] != codon:
                position += 1
            position += 1

    @settings(max_examples=40, deadline=None)
    @given(seed=seeds, value=st.floats(0, 1), name=st.sampled_from(["rocksample", "digits in the test", "chains"]))
    def test_nearest_against_all_codons_there_are(self, words, name, seed, value):
        """Every assignment of codons to a constant's slots, mapped by the mapper itself."""
        grammar = named(name)
        codons, derivation = sentence(grammar, seed, 16)
        spans = constant_spans(derivation.phenotype, words)
        places = Speller(grammar, 16).places(codons, spans)
        k = next((i for i, place in enumerate(places) if place), None)
        if k is None:
            return
        slots = places[k].slots
        spelled = set()
        choices = [c for slot in slots for c in range(slot.first, slot.last)]
        for assignment in itertools.product(range(10), repeat=len(choices)) if len(choices) < 4 else ():
            other = codons.copy()
            other[choices] = assignment
            text = derive(grammar, other).phenotype
            if text is not None and len(parse(text, words).constants) == len(spans):
                spelled.add(float(parse(text, words).constants[k]))
        if spelled:
            nearest = places[k].values[places[k].nearest(value)]
            assert abs(nearest - value) <= min(abs(x - value) for x in spelled) + 1e-12
            assert spelled <= set(places[k].values)

    @settings(max_examples=60, deadline=None)
    @given(name=grammars, seed=seeds)
    def test_the_tree_is_the_mapper_s(self, name, seed):
        grammar = named(name)
        codons, derivation = sentence(grammar, seed)
        text, tree_nodes = nodes(grammar, codons)
        assert text == derivation.phenotype
        assert [list(node[:3]) for node in tree_nodes] == derivation.nodes.tolist()

    def test_by_hand(self, words):
        """code, line 1, test 0, d, d, op: 0.<d><d> becomes 0.85, each codon keeping its multiple of four."""
        grammar = named("digits in the test")
        codons = np.array([2, 7, 8, 13, 401, 9], dtype=np.int32)
        assert derive(grammar, codons).phenotype == "if(belief(3) > 0.22) sample()"
        speller = Speller(grammar, 1000)
        (place,) = speller.places(codons, constant_spans("if(belief(3) > 0.22) sample()", words))
        assert len(place.values) == 16
        assert speller.write(codons, [place], [0.84]).tolist() == [2, 7, 8, 15, 402, 9]
        assert speller.write(codons, [place], [0.49]).tolist() == [2, 7, 8, 14, 400, 9]  # 0.51 is nearer than 0.28

    def test_spellings_of_other_lengths_and_doubles(self, words):
        grammar = named("any number of digits")
        codons = np.array([0, 1, 0, 0, 2, 0], dtype=np.int32)
        text = derive(grammar, codons).phenotype
        assert text == "if(belief(1) > 0.7) up()"
        speller = Speller(grammar, 1000)
        places = speller.places(codons, constant_spans(text, words))
        longer = speller.write(codons, places, [0.4714])
        assert derive(grammar, longer).phenotype == "if(belief(1) > 0.4714) up()"
        back = speller.write(
            longer, speller.places(longer, constant_spans("if(belief(1) > 0.4714) up()", words)), [0.69]
        )
        assert derive(grammar, back).phenotype == "if(belief(1) > 0.7) up()"

    def test_two_numbers_that_change_their_lengths(self, words):
        grammar = named("any number of digits")
        codons = np.array([1, 0, 1, 0, 0, 2, 0, 1, 1, 0, 0, 1], dtype=np.int32)
        text = derive(grammar, codons).phenotype
        assert text == "if(belief(1) > 0.7) up() if(belief(4) > 0.1) sample()"
        speller = Speller(grammar, 1000)
        new = speller.write(codons, speller.places(codons, constant_spans(text, words)), [0.147, 0.41])
        assert derive(grammar, new).phenotype == "if(belief(1) > 0.147) up() if(belief(4) > 0.41) sample()"

    def test_numbers_that_no_rule_spells_stay(self, words):
        grammar = bnf.parse("<code> ::= if(<test>) up()\n<test> ::= belief(1) > 0.5 | belief(2) > 0.7\n")
        codons = np.array([1], dtype=np.int32)
        speller = Speller(grammar, 1000)
        places = speller.places(codons, constant_spans("if(belief(2) > 0.7) up()", words))
        assert places == [None]
        assert speller.write(codons, places, [0.5]).tolist() == [1]


def taught(text_of):
    """A way to learn that has nothing to do with constants: every letter becomes b."""

    def refine(individuals, generation):
        return [text_of(individual) for individual in individuals], 1000

    return refine


class TestLoop:
    p = Parameters(population=12, generations=3, max_init_depth=12, refine=2, refine_every=2)

    def lamarck(self, individual):
        codons = individual.codons.copy()
        for rule, first, _ in individual.derivation.nodes:
            if rule == 1 and codons[first] % 3 == 0:
                codons[first] = 1
        return loop.Learnt(codons, derive(LISTS, codons).phenotype)

    def baldwin(self, individual):
        return loop.Learnt(individual.codons, self.lamarck(individual).phenotype)

    def run(self, text_of, population=None, start=0):
        population = population or loop.first_population(LISTS, self.p)
        lesson = loop.Lesson(taught(text_of), self.p.refine, self.p.refine_every)
        return list(loop.evolve(LISTS, self.p, letters, population, start, lessons=[lesson]))

    def test_lamarck_passes_on_what_baldwin_only_is_judged_by(self):
        plain = list(loop.evolve(LISTS, self.p, letters, loop.first_population(LISTS, self.p)))
        lamarck, baldwin = self.run(self.lamarck), self.run(self.baldwin)
        for generations in (lamarck, baldwin):  # the same until something is learnt
            assert generations[1].fitness.tolist() == plain[1].fitness.tolist()
            learnt = generations[2]
            best = list(plain[2].ranking())[:2]
            for i, before in enumerate(plain[2].phenotypes):
                taught_text = before.replace("a", "b") if before in best else before
                assert learnt.phenotypes[i] == taught_text
                score = -np.inf if taught_text is None else letters([taught_text], 2).fitness[0]
                assert learnt.fitness[i] == score
            new = {t.replace("a", "b") for t in best} - plain[2].ranking().keys()  # the others have a fitness already
            assert learnt.cost == plain[2].cost + 1000 + len(new)
            assert [c.tolist() for c in learnt.population] == [c.tolist() for c in plain[2].population]
        assert [i.codons.tolist() for i in baldwin[2].individuals] == [c.tolist() for c in plain[2].population]
        for individual, phenotype in zip(lamarck[2].individuals, lamarck[2].phenotypes, strict=True):
            assert individual.derivation.phenotype == phenotype

    @pytest.mark.parametrize("kind", ["lamarck", "baldwin"])
    def test_going_on_from_any_generation_is_as_if_never_stopped(self, kind):
        whole = self.run(getattr(self, kind))
        for start in (1, 2, 3):
            rest = self.run(getattr(self, kind), whole[start].population, start)
            for a, b in zip(whole[start:], rest, strict=True):
                assert a.fitness.tolist() == b.fitness.tolist()
                assert a.phenotypes == b.phenotypes
                assert (a.cost, a.number) == (b.cost, b.number)


def best_individuals(grammar, fitness, size=40):
    """Some different individuals with constants."""
    p = fitness.parameters
    codons = [tree(grammar, 0, 9, GROW, p.codon_size, np.random.default_rng(k)) for k in range(size)]
    parents = [Parent(c, derive(grammar, c)) for c in codons]
    return [a for a in parents if len(fitness.compile(a.derivation.phenotype).constants)]


class TestRefiner:
    @pytest.mark.parametrize("tuner", ["lines", "autodiff"])
    @pytest.mark.parametrize("inheritance", ["lamarckian", "baldwinian"])
    def test_never_worse_on_the_tuning_episodes(self, rocksample, words, inheritance, tuner):
        p = Parameters(refine=5, refine_every=1, inheritance=inheritance, refine_episodes=60, tuner=tuner)
        fitness, grammar = ProgramFitness(rocksample, p, "tables", 1), bnf.parse(LOOK)
        individuals = best_individuals(grammar, fitness)
        learnt, steps = Refiner(grammar, fitness)(individuals, 7)
        before = [parse(a.derivation.phenotype, words) for a in individuals]
        after = [parse(new.phenotype, words) for new in learnt]
        episodes = Episodes(rng.REFINEMENT, 7 * 60, 60, 50)
        old, new = (
            population.play(rocksample, programs, episodes).returns.mean(axis=1) for programs in (before, after)
        )
        assert (new >= old).all()
        assert (new > old).any()
        assert steps > 0
        for individual, result, program in zip(individuals, learnt, after, strict=True):
            assert (
                program.with_constants(0 * program.constants).text
                == parse(individual.derivation.phenotype, words).with_constants(0 * program.constants).text
            )
            if inheritance == "lamarckian":
                assert derive(grammar, result.codons).phenotype == result.phenotype
            else:
                assert result.codons is individual.codons

    def test_twins_learn_once(self, rocksample):
        p = Parameters(refine=1, refine_every=1, refine_episodes=20)
        fitness, grammar = ProgramFitness(rocksample, p, "tables", 1), bnf.parse(LOOK)
        one = best_individuals(grammar, fitness)[0]
        refiner = Refiner(grammar, fitness)
        (alone,), cost = refiner([one], 3)
        twins, both = refiner([one, one], 3)
        assert both == cost
        assert [t.phenotype for t in twins] == [alone.phenotype] * 2

    def test_rivals_differ_from_what_they_came_from(self, rocksample):
        p = Parameters(refine=5, refine_episodes=60)
        fitness, grammar = ProgramFitness(rocksample, p, "tables", 1), bnf.parse(LOOK)
        texts = [a.derivation.phenotype for a in best_individuals(grammar, fitness)][:6]
        made, steps = rivals(fitness, [*texts, "right()"], 9)
        assert made
        assert steps > 0
        assert not set(made) & {fitness.compile(text).text for text in texts}


KINDS = {
    "end": {},
    "lamarckian": {"refine_every": 3, "inheritance": "lamarckian"},
    "baldwinian": {"refine_every": 3, "inheritance": "baldwinian"},
    "autodiff": {"refine_every": 3, "tuner": "autodiff"},
}


@pytest.fixture
def look(tmp_path):
    path = tmp_path / "look.bnf"
    path.write_text(LOOK)
    return path


class TestRuns:
    @pytest.mark.parametrize("kind", KINDS)
    def test_stopped_anywhere_and_resumed_it_is_the_same_run(self, tmp_path, look, kind, monkeypatch):
        options = {**SMALL, **KINDS[kind], "engine": "tables", "workers": 1}
        harness.evolve("rocksample-7x8", look, out=tmp_path / "whole", **options)
        for stop in (3, 4, 8):
            folder, plain = tmp_path / f"stopped-{stop}", search._row

            def row(tested, generation, seconds, stop=stop, plain=plain):
                if generation.number == stop:
                    raise KeyboardInterrupt
                return plain(tested, generation, seconds)

            monkeypatch.setattr(search, "_row", row)
            with pytest.raises(KeyboardInterrupt):
                harness.evolve("rocksample-7x8", look, out=folder, **options)
            monkeypatch.undo()
            assert count(folder) == stop
            harness.resume(folder, workers=2)
            assert same(results(tmp_path / "whole"), results(folder))

    def test_killed_and_resumed_it_ends_the_same(self, tmp_path, look):
        """A real process, killed by SIGKILL at whatever it is doing, twice."""
        options = [
            "rocksample-7x8", "--grammar", str(look),
            "--engine", "tables", "--population", "30", "--generations", str(size(12, 25)), "--episodes", "20",
            "--max-init-depth", "25", "--tournament", "4", "--score-episodes", "300", "--crossover", "subtree",
            "--refine", "3", "--refine-every", "2", "--refine-episodes", "40",
        ]  # fmt: skip
        whole, killed = tmp_path / "whole", tmp_path / "killed"
        assert main(["evolve", *options, "--out", str(whole)]) == 0
        arguments = [*options, "--out", str(killed)]
        for _ in range(2):
            process = subprocess.Popen(
                [sys.executable, "-m", "harness", "evolve", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE
            )
            rows = count(killed)
            while count(killed) <= rows and process.poll() is None:
                time.sleep(0.01)
            process.send_signal(signal.SIGKILL)
            process.communicate()
            arguments = ["--resume", str(killed)]
        assert count(killed) >= 1
        assert main(["evolve", "--resume", str(killed)]) == 0
        assert same(results(whole), results(killed))

    @pytest.mark.parametrize("kind", KINDS)
    def test_workers_change_nothing_and_every_step_is_counted(self, look, kind, monkeypatch):
        options = {**SMALL, **KINDS[kind], "engine": "tables"}
        other = harness.evolve("rocksample-7x8", look, workers=3, **options)
        counted, tuning, plain, last = [], set(), population.play, (SMALL["generations"] + 1) * SMALL["episodes"]
        learning = [3, 6] if kind != "end" else []

        def play(domain, programs, episodes, *rest, **more):
            played = plain(domain, programs, episodes, *rest, **more)
            if episodes.seed == rng.REFINEMENT or (episodes.seed == rng.TRAINING and episodes.first < last):
                counted.append(int(played.steps.sum()))
            if episodes.seed == rng.REFINEMENT:
                tuning.add((episodes.first, episodes.size))
            return played

        def computed(*arguments):
            found = forward(*arguments)
            counted.append(found.situations)
            return found

        monkeypatch.setattr(population, "play", play)
        monkeypatch.setattr(refinement, "forward", computed)
        result = harness.evolve("rocksample-7x8", look, workers=1, **options)
        pd.testing.assert_frame_equal(
            result.history.drop(columns="seconds"), other.history.drop(columns="seconds"), check_exact=True
        )
        assert result.best.text == other.best.text
        pd.testing.assert_frame_equal(result.finalists, other.finalists, check_exact=True)
        assert result.history["steps"].sum() == sum(counted)
        assert tuning == {(30 * generation, 30) for generation in [*learning, 9]}  # each time others

    def test_until_something_is_learnt_it_is_the_plain_run(self, look):
        plain = harness.evolve("rocksample-7x8", look, engine="tables", workers=1, **{**SMALL, "refine": 0})
        end = harness.evolve("rocksample-7x8", look, engine="tables", workers=1, **SMALL)
        columns = [c for c in plain.history.columns if c not in ("seconds", "steps")]
        pd.testing.assert_frame_equal(plain.history[columns], end.history[columns], check_exact=True)
        assert (plain.history["steps"] < end.history["steps"]).tolist() == [False] * 8 + [True]
        tuned = end.finalists[end.finalists["fitness"].isna()]
        assert set(plain.finalists["program"]) == set(end.finalists["program"]) - set(tuned["program"])
        assert end.best.validation >= plain.best.validation

    def test_the_genotypes_of_a_lamarckian_run_spell_what_was_learnt(self, tmp_path, look):
        """The parents of the generation after learning hold the tuned texts."""
        options = {**SMALL, **KINDS["lamarckian"], "generations": 3, "elites": 3, "engine": "tables"}
        harness.evolve("rocksample-7x8", look, out=tmp_path / "run", **options)
        setup = search.restore(RunFolder(tmp_path / "run"), 1)
        fitness = ProgramFitness(setup.domain, setup.parameters, "tables", 1)
        first = loop.first_population(setup.grammar, setup.parameters)
        p = setup.parameters
        lesson = loop.Lesson(Refiner(setup.grammar, fitness), p.refine, p.refine_every)
        generations = list(loop.evolve(setup.grammar, p, fitness, first, lessons=[lesson]))
        before = [derive(setup.grammar, codons).phenotype for codons in generations[3].population]
        changed = [i for i, text in enumerate(before) if text != generations[3].phenotypes[i]]
        assert changed
        for i in changed:
            individual = generations[3].individuals[i]
            assert derive(setup.grammar, individual.codons).phenotype == generations[3].phenotypes[i]


class TestMisuse:
    @pytest.mark.parametrize(
        ("arguments", "words_of_it"),
        [
            (["rocksample-7x8", "--refine-every", "5"], "refine_every needs refine"),
            (["rocksample-7x8", "--refine", "3", "--inheritance", "lamarkian"], "did you mean 'lamarckian'"),
            (["rocksample-7x8", "--refine", "3", "--refine-episodes", "1"], "2 or more"),
            (["bordercross-7x8", "--refine", "3"], "so --refine has nothing to tune"),
            (
                ["rocksample-7x8", "--refine", "3", "--refine-every", "5", "--grammar", "FIXED"],
                "take --inheritance baldwinian, or another grammar",
            ),
        ],
    )
    def test_one_sentence_and_nothing_run(self, tmp_path, capsys, arguments, words_of_it):
        fixed = tmp_path / "fixed.bnf"
        fixed.write_text("<code> ::= <line> | <code> <line>\n<line> ::= if(<test>) up()\n<test> ::= belief(1) > 0.5\n")
        arguments = [str(fixed) if a == "FIXED" else a for a in arguments]
        assert main(["evolve", *arguments, "--out", str(tmp_path / "out")]) == 2
        error = capsys.readouterr().err
        assert words_of_it in error
        assert error.count("\n") == 1
        assert not (tmp_path / "out").exists()

    def test_fixed_numbers_can_be_credited_and_tuned_at_the_end(self, tmp_path):
        fixed = tmp_path / "fixed.bnf"
        fixed.write_text(
            "<code> ::= <line> | <code> <line>\n<line> ::= if(<test>) sample() | up() | right() | check(5)\n"
            "<test> ::= belief(5) > 0.9\n"
        )
        options = {**SMALL, "refine_every": 2, "inheritance": "baldwinian", "engine": "tables"}
        result = harness.evolve("rocksample-7x8", fixed, **options)
        assert len(result.history) == 9
