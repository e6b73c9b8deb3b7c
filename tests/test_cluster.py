"""One executor in threads, processes and Dask: the same numbers on each, and what becomes of what goes wrong."""

from __future__ import annotations

import os
import pickle
import signal
import threading
import time
from collections import deque

import numpy as np
import pandas as pd
import pytest

import harness
from harness.errors import HarnessError
from harness.play import cluster, executor
from harness.policy import make
from tests.conftest import FULL

SEARCH = {"population": 20, "episodes": 20, "test_episodes": 50, "validation_episodes": 50, "score_episodes": 50}


@pytest.fixture(scope="module")
def client(rocksample):
    """Two workers of Dask; what they will need has been compiled here before."""
    distributed = pytest.importorskip("distributed", reason="needs pomdp-harness[cluster]")
    harness.evaluate(rocksample, "belief:0.84", episodes=2, engine="tables")
    options = {"threads_per_worker": 1, "dashboard_address": ":0", "silence_logs": 50}
    with distributed.LocalCluster(n_workers=2, **options) as made, distributed.Client(made) as connected:
        yield connected


class Waiting:
    """Plays at random, and takes its time."""

    name, batch_size, uses_belief = "waiting", 50, False

    def reset(self, batch):
        time.sleep(0.1)

    def act(self, batch):
        return (batch.uniform() * batch.domain.n_actions).astype(np.int64)


def double(factor, item):
    return factor * item


def fail_at(number, item):
    if item == number:
        raise ZeroDivisionError("as it was to be")
    return item


def pretend(fingerprint):
    """On a worker: to be of another version."""
    executor.fingerprint = fingerprint


def same(a, b):
    return all(np.array_equal(getattr(a, n), getattr(b, n)) for n in ("returns", "discounted", "steps", "terminated"))


def name(item):
    return f"item {item}"


class TestEach:
    def test_every_item_once_and_more_may_be_added(self):
        waiting = deque(range(50))
        with cluster.threads(3) as workers:
            found = {}
            for item, result in executor.each(workers, double, waiting, 2, name=name):
                assert item not in found
                found[item] = result
                if item < 10:
                    waiting.append(item + 100)
        assert found == {item: 2 * item for item in [*range(50), *range(100, 110)]}

    def test_results_in_order(self):
        with cluster.threads(2) as workers:
            assert list(executor.ordered(workers, double, list("abc"), 2, name=name)) == ["aa", "bb", "cc"]
        assert list(executor.ordered(None, double, list("abc"), 2, name=name)) == ["aa", "bb", "cc"]

    def test_items_are_put_together_into_tasks_of_a_second(self):
        pace = executor._Pace(alike=True)
        waiting = deque(range(1000))
        assert len(pace.take(waiting, 4)) == 1  # nobody knows yet
        pace.see(0.1, 1)
        assert len(pace.take(waiting, 4)) == 10
        pace.see(0.0, 10**9)
        assert len(pace.take(waiting, 4)) == 989 // 8  # no more than a share for each, and one to follow
        assert len(executor._Pace(alike=False).take(waiting, 4)) == 1

    def test_what_fails_three_times_names_itself(self):
        with (
            cluster.threads(2) as workers,
            pytest.raises(HarnessError, match=r"^item 7 failed 3 times, .* ZeroDivisionError: as it was to be"),
        ):
            list(executor.each(workers, fail_at, [5, 6, 7], 7, name=name))

    def test_other_versions_are_refused(self):
        with pytest.raises(HarnessError, match=r"has pomdp-harness .*, and here is another; install the same on both"):
            executor.work("another", double, executor.pack((2,))[0], {}, [1])

    def test_a_domain_is_not_sent_with_its_policies(self, rocksample):
        shared = (rocksample, make("belief:0.84", rocksample)[1], rocksample.shaped("none"))
        packed, domains = executor.pack(shared)
        assert len(packed) < 20_000 < len(pickle.dumps(rocksample))
        assert list(domains.values()) == [rocksample]
        assert executor.unpack(packed, domains)[0] is rocksample

    def test_what_cannot_be_pickled_is_refused(self, rocksample):
        policy = Waiting()
        policy.lock, policy.clone = threading.Lock(), Waiting
        with (
            harness.cluster("threads:2"),
            pytest.raises(HarnessError, match=r"_Game cannot be sent to workers .* play it without a cluster"),
        ):
            harness.evaluate(rocksample, policy, episodes=10, engine="tables")

    def test_a_task_plays_in_one_thread(self):
        with cluster.threads(1) as workers:
            assert list(executor.ordered(workers, executor.threads, [4], name=name)) == [1]
        assert executor.threads(4) == 4


class TestProcesses:
    def test_a_killed_process_changes_nothing(self, rocksample, tmp_path):
        alone = harness.evaluate(rocksample, Waiting(), episodes=400, engine="tables")
        with harness.cluster("processes:2"):
            workers = executor.current()
            progress = []

            def kill_one(count):
                progress.append(count)
                if len(progress) == 2:
                    os.kill(next(iter(workers._executor._processes)), signal.SIGKILL)

            played = harness.evaluate(rocksample, Waiting(), episodes=400, engine="tables", progress=kill_one)
        assert same(alone, played)
        assert sum(progress) == 400


class TestDask:
    def test_policies_of_all_kinds_score_the_same(self, client, rocksample, tmp_path):
        own = tmp_path / "own_of_mine.py"
        own.write_text("from tests.test_cluster import Waiting\n\nclass Mine(Waiting):\n    batch_size = 100\n")
        policies = ["belief:0.84", "sarsop", "random-legal", f"{own}:Mine"]
        here = harness.compare(rocksample, policies, against="exit", episodes=300, engine="tables")
        with harness.cluster(client):
            there = harness.compare(rocksample, policies, against="exit", episodes=300, engine="tables")
        pd.testing.assert_frame_equal(here, there, check_exact=True)

    def test_sweeps_and_tuning_are_the_same(self, client, rocksample):
        def played():
            sweep = harness.sweep(rocksample, "belief", points=4, episodes=100, engine="tables")
            small = {"episodes": 100, "iterations": 2, "validation_episodes": 100, "final_episodes": 100}
            return sweep, harness.tune(rocksample, "belief:0.7", engine="tables", method="spsa", **small).history

        here = played()
        with harness.cluster(client):
            there = played()
        for a, b in zip(here, there, strict=True):
            pd.testing.assert_frame_equal(a, b, check_exact=True)

    def test_checks_are_the_same(self, client, tmp_path):
        rows = [
            f'[[score]]\ndomain = "{d}"\npolicy = "sarsop"\nepisodes = 50\n'
            for d in ("rocksample-7x8", "bordercross-7x8")
        ]
        here, there = tmp_path / "here.toml", tmp_path / "there.toml"
        for path in (here, there):
            path.write_text("".join(rows))
        harness.update_scores(here)
        with harness.cluster(client):
            harness.update_scores(there)
            assert harness.check_scores(there, exact=True).passed
        assert here.read_text() == there.read_text()

    def test_a_large_population_is_cut(self, client, rocksample, monkeypatch):
        here = harness.evolve(rocksample, generations=2, selection="map-elites", **SEARCH)
        from harness.play import population

        monkeypatch.setattr(population, "_WORTH", 100)
        with harness.cluster(client):
            there = harness.evolve(rocksample, generations=2, selection="map-elites", **SEARCH)
        pd.testing.assert_frame_equal(*(run.history.drop(columns="seconds") for run in (here, there)), check_exact=True)
        assert here.best.text == there.best.text

    def test_runs_travel_and_leave_the_same_folders(self, client, rocksample, tmp_path, monkeypatch):
        from harness.ge import slices

        found = {}
        handing_on = {"selection": "novelty", "layers": 2, "epoch": 2}  # more than a population, from slice to slice
        for where in ("here", "there"):
            with harness.cluster(client if where == "there" else "threads:1"):
                monkeypatch.setattr(slices, "SLICE", 0.0)
                harness.evolve("rocksample-7x8", runs=2, generations=6, out=tmp_path / where, **SEARCH, **handing_on)
            found[where] = {
                str(path.relative_to(tmp_path / where)): path.read_bytes()
                for path in sorted((tmp_path / where).rglob("*"))
                if path.is_file() and path.name not in ("checkpoint.npz", "history.csv", "runs.csv")
            }
        assert found["here"] == found["there"]
        assert "seed-1/best.json" in found["there"]

    def test_killed_workers_change_nothing(self, client, rocksample):
        """Both of them, so that what was sent to them is gone too."""
        alone = harness.evaluate(rocksample, Waiting(), episodes=600, engine="tables")
        numbers, progress = client.run(os.getpid), []

        def kill_them(count):
            progress.append(count)
            if len(progress) == 2:
                for number in numbers.values():
                    os.kill(number, signal.SIGKILL)

        with harness.cluster(client):
            played = harness.evaluate(rocksample, Waiting(), episodes=600, engine="tables", progress=kill_them)
        assert same(alone, played)
        assert not set(client.run(os.getpid).values()) & set(numbers.values())

    def test_workers_of_another_version_are_refused(self, client):
        client.run(pretend, lambda: "pomdp-harness 0.0")
        try:
            with pytest.raises(HarnessError, match=r"^the worker tcp://.* has pomdp-harness 0.0, and here is pomdp-"):
                harness.cluster(client).__enter__()
        finally:
            client.run(pretend, executor.fingerprint)

    @pytest.mark.skipif(not FULL, reason="a scheduler of its own, and the wait for it: make test-full")
    def test_a_scheduler_that_is_gone_ends_it_in_a_sentence(self, client, rocksample):
        import distributed

        options = {"threads_per_worker": 1, "dashboard_address": ":0", "silence_logs": 50}
        made = distributed.LocalCluster(n_workers=1, **options)
        with (
            distributed.Client(made, timeout=2) as connected,
            harness.cluster(connected),
            pytest.raises(HarnessError, match=r"^the scheduler tcp://.* (is gone|does not answer)"),
        ):
            harness.evaluate(rocksample, Waiting(), episodes=600, engine="tables", progress=lambda count: made.close())


class TestWhere:
    @pytest.mark.parametrize(
        ("where", "words"),
        [
            ("dask", "no cluster 'dask' .known: tcp://HOST:PORT"),
            ("loca:4", "did you mean 'local'"),
            ("local:0", "no cluster 'local:0'"),
            ("slurm:", "no cluster 'slurm:'"),
            ("processes:many", "no cluster 'processes:many'"),
            ("slurm:no.toml", "cannot read 'no.toml': No such file"),
        ],
    )
    def test_what_is_no_cluster_is_refused(self, where, words):
        with pytest.raises(HarnessError, match=words), harness.cluster(where):
            pass

    def test_nobody_at_the_address(self, monkeypatch):
        pytest.importorskip("distributed", reason="needs pomdp-harness[cluster]")
        monkeypatch.setattr(cluster, "CONNECT", 0.3)
        with pytest.raises(HarnessError, match=r"^no Dask scheduler answers at 'tcp://127.0.0.1:9'"):
            harness.cluster("tcp://127.0.0.1:9").__enter__()

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("jobs = 2\ncores = 4\n", "'memory' is missing"),
            ("jobs = 0\ncores = 4\nmemory = '8GB'\n", "'jobs' must be a whole number, 1 or more, not 0"),
            ("jobs = 2\ncores = '4'\nmemory = '8GB'\n", "'cores' must be a whole number, 1 or more, not '4'"),
            ("jobs = 2\ncores = 4\nmemory = '8GB'\nqeue = 'long'\n", "no key 'qeue'; did you mean 'queue'"),
            ("jobs = 2\ncores = 4\nmemory = '8GB'\nprologue = 'x'\n", "'prologue' must be a list of texts, not 'x'"),
            ("jobs = \n", "line 1"),
        ],
    )
    def test_what_is_wrong_in_a_file_of_jobs_is_named(self, tmp_path, text, words):
        path = tmp_path / "slurm.toml"
        path.write_text(text)
        with pytest.raises(HarnessError, match=f"slurm.toml: .*{words}"):
            cluster.job_options(path)

    def test_a_file_of_jobs_is_what_the_batch_system_is_told(self, tmp_path):
        jobqueue = pytest.importorskip("dask_jobqueue", reason="needs pomdp-harness[cluster]")
        path = tmp_path / "slurm.toml"
        path.write_text(
            'jobs = 25\ncores = 40\nmemory = "80GB"\nwalltime = "02:00:00"\nqueue = "long"\naccount = "me"\n'
            'directives = ["--exclusive"]\nprologue = ["module load python"]\n'
        )
        count, options = cluster.job_options(path)
        assert count == 25
        with jobqueue.SLURMCluster(**options, scheduler_options={"dashboard_address": ":0"}) as made:
            script = made.job_script()
        for line in ("-p long", "-A me", "-t 02:00:00", "--cpus-per-task=40", "--exclusive"):
            assert f"#SBATCH {line}\n" in script
        assert "module load python\n" in script
        assert "--nworkers 40 " in script
        assert "--nthreads 1 " in script
