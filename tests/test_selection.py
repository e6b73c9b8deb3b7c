"""Selection by cases and by behaviour, and the structure of the population."""

from __future__ import annotations

import itertools
import math
import shutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import harness
from harness import HarnessError
from harness.ge import loop, selection, structure
from harness.ge.loop import Evaluated
from harness.ge.parameters import SELECTIONS, Parameters
from harness.ge.selection import Pool
from harness.model import archive as files
from harness.play.evaluation import simulate
from harness.play.population import Episodes, play
from harness.policy.program import ProgramPolicy
from harness.program import parse, words_of
from tests import models
from tests.test_evolution import LISTS, SMALL, results, same

rngs = st.integers(0, 2**32).map(np.random.default_rng)


def median(values):
    ordered, middle = sorted(values), len(values) // 2
    return ordered[middle] if len(ordered) % 2 else (ordered[middle - 1] + ordered[middle]) / 2


def chances(cases):
    """Probability that each individual wins, by the definition: all orders of the cases, equally likely."""
    n, orders = len(cases), list(itertools.permutations(range(len(cases[0]))))
    epsilon = [median([abs(row[c] - median([r[c] for r in cases])) for row in cases]) for c in range(len(cases[0]))]
    won = [0.0] * n
    for order in orders:
        left = list(range(n))
        for c in order:
            best = max(cases[i][c] for i in left)
            left = [i for i in left if cases[i][c] >= best - epsilon[c]]
        for i in left:
            won[i] += 1 / len(left) / len(orders)
    return won


class TestLexicase:
    def test_winners_are_as_frequent_as_the_definition_says(self):
        generator, count = np.random.default_rng(4), 40_000
        for _ in range(6):
            cases = generator.integers(0, 6, (7, 5)).astype(float)
            pool = Pool(cases.mean(axis=1), cases)
            p = Parameters(selection="lexicase")
            won = np.bincount(selection.parents(pool, np.arange(1), p, count, generator), minlength=7) / count
            np.testing.assert_allclose(won, chances(cases.tolist()), atol=5 * 0.5 / math.sqrt(count))

    def test_a_specialist_is_chosen_that_no_tournament_would_take(self):
        cases = np.array([[5.0, 5.0, 0.0], [4.0, 4.0, 3.0], [4.0, 4.0, 3.0], [4.0, 4.0, 3.0], [0.0, 0.0, 9.0]])
        pool, generator = Pool(cases.mean(axis=1), cases), np.random.default_rng(0)
        assert pool.fitness.argmin() == 4
        lexicase = selection.parents(pool, np.arange(1), Parameters(selection="lexicase"), 500, generator)
        assert (lexicase == 4).sum() > 100

    def test_down_sampled_it_sees_the_same_few_cases_for_all_parents_of_a_generation(self):
        cases = np.eye(10)  # individual i is the best in case i alone
        p, seen = Parameters(selection="lexicase", cases=0.2), set()
        for seed in range(30):
            won = selection.parents(Pool(cases.mean(axis=1), cases), np.arange(1), p, 99, np.random.default_rng(seed))
            assert len(set(won.tolist())) == 2
            seen |= set(won.tolist())
        assert seen == set(range(10))

    def test_invalid_individuals_never_win_unless_all_are(self):
        cases = np.array([[-np.inf] * 3, [1.0, 2.0, 3.0], [-np.inf] * 3])
        p, generator = Parameters(selection="lexicase"), np.random.default_rng(0)
        assert set(selection.parents(Pool(cases.mean(axis=1), cases), np.arange(1), p, 50, generator)) == {1}
        nobody = Pool(np.full(3, -np.inf), np.full((3, 3), -np.inf))
        assert set(selection.parents(nobody, np.arange(1), p, 50, generator)) == {0, 1, 2}


class TestBehaviour:
    @settings(max_examples=30, deadline=None)
    @given(generator=rngs, n=st.integers(1, 40), seen=st.integers(0, 30))
    def test_novelty_is_the_mean_distance_to_the_nearest(self, generator, n, seen):
        own, before = generator.random((n, 3)).round(1), generator.random((seen, 3)).round(1)
        found = selection.novelty(own, before)
        for i in range(n):
            others = [*np.delete(own, i, axis=0), *before]
            nearest = sorted(math.dist(own[i], other) for other in others)[:15]
            assert found[i] == pytest.approx(sum(nearest) / len(nearest) if nearest else 0, abs=1e-12)

    @settings(max_examples=30, deadline=None)
    @given(generator=rngs, n=st.integers(1, 60), most=st.integers(1, 30))
    def test_the_archive_holds_the_fittest_of_each_cell(self, generator, n, most):
        descriptors = generator.random((n, 3)).round(2)
        fitness = np.where(generator.random(n) < 0.2, -np.inf, generator.integers(0, 9, n))
        kept = selection.archive(Pool(fitness, None, descriptors), most).tolist()
        valid = [i for i in range(n) if np.isfinite(fitness[i])]
        assert len(kept) <= most
        assert bool(kept) == bool(valid)
        if not valid:
            return
        grids = []  # of each grid: the best fitness by cell
        for parts in range(1, 51):
            cells = {}
            for i in valid:
                cell = tuple(min(math.floor(x * parts), parts - 1) for x in descriptors[i])
                cells[cell] = max(cells.get(cell, -1), fitness[i])
            grids.append(sorted(cells.values()))
        fine = next((k for k, grid in enumerate(grids) if len(grid) > most), 50)
        assert sorted(fitness[kept]) == grids[fine - 1]

    def test_parents_are_drawn_from_the_archive_alone(self):
        pool = Pool(np.arange(10.0), None, np.repeat(np.eye(3), [3, 3, 4], axis=0))
        p, generator = Parameters(selection="map-elites"), np.random.default_rng(0)
        kept = selection.survivors(pool, p, 10)
        assert sorted(kept) == [2, 5, 9]
        won = np.bincount(selection.parents(pool, kept, p, 30_000, generator), minlength=10)
        np.testing.assert_allclose(won[[2, 5, 9]] / 30_000, 1 / 3, atol=0.02)
        assert won.sum() == won[[2, 5, 9]].sum()

    def test_the_archive_of_novelty_search_grows_by_valid_ones(self):
        pool = Pool(np.array([1.0, -np.inf, 2.0]), None, np.array([[0.1] * 3, [-np.inf] * 3, [0.3] * 3]))
        first = selection.remembered(pool, np.random.default_rng(0))
        assert sorted(first[:, 0]) == [0.1, 0.3]
        assert len(selection.remembered(pool._replace(seen=first), np.random.default_rng(0))) == 4

    @pytest.mark.parametrize("name", ["rocksample-7x8", "bordercross-7x8-random", "tiger"])
    def test_behaviours_are_what_a_replay_shows(self, name):
        """Step by step through the engine, in plain Python."""
        domain = models.tiger() if name == "tiger" else harness.load(name)
        texts = {
            "rocksample-7x8": ['check(1) check(2) if(1 == "good") up() left() right() right()', "loop right()"],
            "bordercross-7x8-random": ["loop if(distance() < 4) down(1) else right(2)", "up(1) up(1)"],
            "tiger": ["a0() a1()", "loop a0()"],
        }[name]
        programs = [parse(text, words_of(domain)) for text in texts]
        played = play(domain, programs, Episodes(7, 3, 20, 12), workers=1)
        for k, program in enumerate(programs):
            visited, readings = [set() for _ in range(20)], 0
            for record in simulate(domain, ProgramPolicy(program), "tables", 7, 3, 20, 12):
                for e in range(20):
                    visited[e].add(int(record.batch.visible[e]))
                    if record.actions is not None and record.active[e]:
                        told = int(record.batch.observation[e])
                        readings += told >= 0 and domain.observations[told] != "none"
            assert played.visited[k] == sum(map(len, visited))
            assert played.readings[k] == readings


def test_of_those_that_earn_the_same_everywhere_the_first_breeds():
    cases = np.array([[1.0, 2.0], [2.0, 1.0], [1.0, 2.0], [-np.inf, -np.inf], [2.0, 1.0]])
    assert selection.distinct(Pool(cases.mean(axis=1), cases)).tolist() == [0, 1, 3]
    assert selection.distinct(Pool(np.array([3.0, 1.0, 3.0]))).tolist() == [0, 1]  # expected returns


def letters(phenotypes, generation):
    """The number of b's in the whole text; each half of it is a case."""
    cases = np.array([[text[::2].count("b"), text[1::2].count("b")] for text in phenotypes], dtype=float) * 2
    descriptors = np.array([[min(len(text), 99) / 99, text.count("(") / len(text), 0] for text in phenotypes])
    return Evaluated(cases.mean(axis=1), 1, 0, cases, descriptors)


def course(**parameters):
    p = Parameters(max_init_depth=12, mutation="structural", crossover="subtree", **parameters)
    return list(loop.evolve(LISTS, p, letters, loop.first_population(LISTS, p)))


def letters_of(generation):
    return [tuple(codons.tolist()) for codons in generation.population]


class TestStructure:
    def test_islands_hear_of_each_other_once_an_epoch_along_the_ring(self):
        """Without crossover and mutation individuals are copies, so that everybody's origin can be told."""
        p = Parameters(
            population=40, generations=9, islands=4, epoch=3, crossover_probability=0, mutation_probability=0
        )
        population = [np.array([0, 3 * (k // 10)], dtype=np.int32) for k in range(40)]  # each derives "a"

        def origin(codons):
            return int(codons[1]) // 3

        def fitness(phenotypes, generation):
            return Evaluated(np.ones(len(phenotypes)), 1, 0)

        for generation in loop.evolve(LISTS, p, fitness, population):
            reached = generation.number // 3
            for k, places in enumerate(structure.groups(p)):
                found = {origin(generation.population[i]) for i in places}
                assert found <= {(k - back) % 4 for back in range(reached + 1)}
        assert len({origin(codons) for codons in generation.population[:10]}) > 1

    def test_the_best_take_the_places_of_the_worst(self):
        p = Parameters(population=40, islands=4, epoch=3)
        pools = [structure.pools(p, np.arange(40.0), np.zeros(40, np.int32), number) for number in (2, 3)]
        assert [pool.tolist() for pool in pools[0]] == [list(range(k, k + 10)) for k in (0, 10, 20, 30)]
        assert [pool[0] for pool in pools[1]] == [39, 9, 19, 29]
        assert [pool[1:].tolist() for pool in pools[1]] == [list(range(k + 1, k + 10)) for k in (0, 10, 20, 30)]

    def test_nobody_is_older_than_the_layer_allows(self):
        p = {"population": 50, "generations": 60, "layers": 5, "epoch": 3, "tournament": 3}
        limits = [3 * factor for factor in (1, 2, 4, 9)]
        fresh = []
        for generation in course(**p):
            age = generation.number - generation.past.born
            for k, limit in enumerate(limits):
                assert age[10 * k : 10 * k + 10].max() <= limit
            fresh.append((generation.past.born[:10] == generation.number).all())
        assert np.flatnonzero(fresh).tolist() == list(range(0, 61, 3))
        assert age[40:].max() == 60  # whose line is as old as the run: the best have no limit
        assert len(set(age.tolist())) >= 5

    def test_a_child_is_as_old_as_the_older_of_its_parents(self):
        for before, after in itertools.pairwise(course(population=20, generations=12, layers=2, epoch=4)):
            births = set(before.past.born.tolist()) | {after.number}
            assert set(after.past.born.tolist()) <= births
            assert after.past.born[10:].max() <= before.past.born.max()

    @pytest.mark.parametrize("more", [{"islands": 5}, {"layers": 5}])
    @pytest.mark.parametrize("word", SELECTIONS)
    def test_all_of_them_together_keep_the_population_in_size_and_find_something(self, word, more):
        generations = course(population=53, generations=15, selection=word, distinct=True, epoch=4, **more)
        assert all(len(generation.population) == len(generation.past.born) == 53 for generation in generations)
        assert generations[-1].fitness.max() > generations[0].fitness.max()


RUNS = [
    {"selection": "lexicase", "distinct": True},
    {"selection": "novelty"},
    {"selection": "map-elites", "islands": 3, "epoch": 2},
    {"layers": 4, "epoch": 2},
]


class TestRuns:
    @pytest.mark.parametrize("more", RUNS, ids=str)
    def test_stopped_and_gone_on_with_by_any_workers_a_run_is_the_same(self, tmp_path, more):
        """Nothing but the folder tells the second half what the first has seen."""
        told = {**SMALL, "generations": 9, "grammar": "rocksample-feedback", **more}
        whole = harness.evolve("rocksample-7x8", out=tmp_path / "whole", workers=1, **told)
        harness.evolve("rocksample-7x8", out=tmp_path / "half", workers=2, **{**told, "generations": 5})
        shutil.copytree(tmp_path / "half", tmp_path / "elsewhere")
        harness.resume(tmp_path / "elsewhere", generations=9, workers=2)
        assert same(results(tmp_path / "whole"), results(tmp_path / "elsewhere"))
        plain = harness.evolve("rocksample-7x8", "rocksample-feedback", workers=1, **SMALL)
        assert plain.history["mean"].tolist() != whole.history["mean"].tolist()[:7]

    def test_what_is_handed_on_is_in_the_checkpoint(self, tmp_path):
        harness.evolve("rocksample-7x8", out=tmp_path, workers=1, selection="novelty", layers=3, epoch=2, **SMALL)
        _, arrays = files.read(tmp_path / "checkpoint.npz", "checkpoint", "")
        assert set(arrays["born"]) > {0, 6}
        assert arrays["seen"].shape == (6 * selection.REMEMBERED, 3)

    def test_a_checkpoint_of_an_older_version_is_gone_on_with(self, tmp_path):
        harness.evolve("rocksample-7x8", out=tmp_path / "new", workers=1, **SMALL)
        shutil.copytree(tmp_path / "new", tmp_path / "old")
        path = tmp_path / "old" / "checkpoint.npz"
        record, arrays = files.read(path, "checkpoint", "")
        record = {name: record[name] for name in ("generation", "history")}
        files.write(path, "checkpoint", record, {name: arrays[name] for name in ("codons", "lengths")})
        for name in ("new", "old"):
            harness.resume(tmp_path / name, generations=8, workers=1)
        assert same(results(tmp_path / "new"), results(tmp_path / "old"))

    def test_learning_changes_cases_and_behaviour_too(self):
        """Of those that learn, they are those of what has been learnt."""

        def refine(individuals, generation):
            return [loop.Learnt(individual.codons, "b b b") for individual in individuals], 1

        p = Parameters(population=20, generations=3, max_init_depth=12, selection="lexicase", refine=2, refine_every=1)
        lesson = loop.Lesson(refine, p.refine, p.refine_every)
        for generation in loop.evolve(LISTS, p, letters, loop.first_population(LISTS, p), lessons=[lesson]):
            expected = letters([text or "" for text in generation.phenotypes if text], 0)
            assert np.array_equal(generation.cases, expected.cases)
            assert np.array_equal(generation.descriptors, expected.descriptors)
            assert np.array_equal(generation.fitness, expected.fitness)
            assert ("b b b" in generation.phenotypes) == (generation.number > 0)

    def test_the_mean_of_the_cases_is_the_fitness_penalty_included(self, rocksample):
        from harness.ge.fitness import ProgramFitness

        fitness = ProgramFitness(rocksample, Parameters(episodes=30, distinct=True, free_length=2), "tables", 1)
        deep = "if(x() > 0) { " * 60 + "up()" + " }" * 60
        found = fitness(["right() " * 7, deep, "check(4) if(belief(4) > 0.7) right() up()"], 1)
        np.testing.assert_allclose(found.cases.mean(axis=1), found.fitness)
        assert np.isneginf(found.cases[1]).all()
        np.testing.assert_allclose(found.descriptors[0], [8 / 50, 0, 7 / 50])  # seven cells and the end
        assert found.descriptors[2][1] == pytest.approx(1 / 50)

    @pytest.mark.parametrize("fitness", ["exact", "auto"])
    def test_parents_are_chosen_by_episodes_where_the_fitness_is_what_is_expected(self, rocksample, fitness):
        """A look at rock 3 from the way, and 10 more where it is good; the rest is the way out (SPEC, section 1)."""
        from harness.ge.fitness import ProgramFitness

        parameters = Parameters(episodes=400, selection="lexicase", fitness=fitness, penalty=0)
        judge = ProgramFitness(rocksample, parameters, "tables", 1)
        texts = ["right() " * 7, 'check(3) if(3 == "good") up() ' + "right() " * 7]
        found, alone = judge(texts, 1), judge.alone(texts, 1)
        assert found.fitness.tolist() == alone.fitness.tolist() == [10, 10]
        assert found.cases.shape == (2, 400)
        assert alone.cases is None
        assert (found.cases == 10).all()
        assert found.cost > alone.cost
        looking = judge(["right() " * 3 + "down() down() sample() " + "right() " * 4], 1)
        assert looking.fitness[0] == pytest.approx(10)  # a rock is as often bad as good
        assert set(looking.cases[0].tolist()) == {0, 20}


class TestMisuse:
    @pytest.mark.parametrize(
        ("parameters", "words"),
        [
            ({"selection": "lexicas"}, "did you mean 'lexicase'"),
            ({"replacement": "steady-state", "islands": 2}, "take replacement generational"),
            ({"replacement": "steady-state", "selection": "novelty"}, "take replacement generational"),
            ({"islands": 2, "layers": 2}, "islands or layers, not both"),
            ({"population": 20, "islands": 10, "elites": 2}, "10 groups of a population of 20 are too small"),
            ({"population": 20, "layers": 20}, "are too small"),
            ({"cases": 1.5}, "cases must be 1 or less"),
            ({"epoch": 0}, "epoch must be 1 or more"),
        ],
    )
    def test_one_sentence(self, parameters, words):
        with pytest.raises(HarnessError, match=words) as told:
            harness.evolve("rocksample-7x8", **parameters)
        assert "\n" not in str(told.value)
