"""One process, processes and Dask on this machine, in one run: seconds, what communication costs, bytes on the wire.

    python -m benchmarks.cluster [--workers 4] [--programs 8000]      # needs pomdp-harness[cluster]

The work is the fitness of random programs, 100 episodes each of RockSample(7, 8). Lost to communication is the share of
the workers' time that they did not spend in tasks: on fewer cores than workers that is their waiting for a core too.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from tabulate import tabulate

import harness
from benchmarks.evolution import random_genotypes
from harness import host, registry
from harness.ge import grammar as bnf
from harness.ge.mapping import derive
from harness.play import executor, population
from harness.program import parse, words_of

EPISODES = 100


class Meter:
    """Workers that count what goes through them: seconds in tasks, and bytes as they are pickled."""

    def __init__(self, inner: executor.Workers) -> None:
        self.inner, self.name, self.here = inner, inner.name, inner.here
        self.slots, self.share, self.recover = inner.slots, inner.share, inner.recover
        self.tasks: list[float] = []
        self.sent = self.received = 0

    def submit(self, function, *arguments):
        future = self.inner.submit(function, *arguments)
        self.sent += sum(len(executor.pack((each,))[0]) for each in (arguments[1], arguments[2], arguments[4]))
        future.add_done_callback(self._see)
        return future

    def _see(self, future) -> None:
        seconds, results = future.result()
        self.tasks.append(seconds)
        self.received += len(executor.pack((results,))[0])


@contextmanager
def metered(where: str) -> Iterator[Meter]:
    with harness.cluster(where):
        meter = Meter(executor.current())
        with executor.using(meter):
            yield meter


def programs(count: int) -> list:
    domain = harness.load("rocksample-7x8")
    grammar, words = bnf.read(registry.grammar_path("rocksample")), words_of(domain)
    genotypes = (g for k in range(-(-count // 250)) for g in random_genotypes(grammar, k))
    return [parse(derive(grammar, g).phenotype or "", words) for g in genotypes]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, default=4)
    parser.add_argument("--programs", type=int, default=8000)
    options = parser.parse_args()
    domain, some = harness.load("rocksample-7x8"), programs(options.programs)
    episodes = population.Episodes(0, 0, EPISODES, 50)
    print(f"{len(some):,} programs, {EPISODES} episodes each; {host.cores()} cores")

    def played():
        began = time.perf_counter()
        result = population.play(domain, some, episodes)
        return result, time.perf_counter() - began

    played()  # compiles
    alone, seconds = played()
    lines = [["one process", f"{seconds:.2f}", "1.0", "", "", "", "", ""]]
    for where in (f"processes:{options.workers}", f"local:{options.workers}"):
        with metered(where) as meter:
            played()  # imports, and loads what was compiled
            meter.tasks.clear()
            meter.sent = meter.received = 0
            result, took = played()
        assert np.array_equal(result.returns, alone.returns)
        busy, tasks = sum(meter.tasks), len(meter.tasks)
        lines.append(
            [
                where,
                f"{took:.2f}",
                f"{seconds / took:.2f}",
                f"{1 - busy / (took * options.workers):.0%}",
                tasks,
                f"{np.median(meter.tasks):.2f}",
                f"{meter.sent / 1e6:.2f}",
                f"{meter.received / 1e6:.2f}",
            ]
        )
    headers = ["where", "s", "speed-up", "lost", "tasks", "s a task", "MB sent", "MB back"]
    print(tabulate(lines, headers, disable_numparse=True))


if __name__ == "__main__":
    main()
