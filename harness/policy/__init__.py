"""Policies, and the strings that name them on the command line and in tables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from harness import files, registry
from harness.errors import PolicyError, nearest, quoted
from harness.model.agents import local_view
from harness.model.domain import Domain
from harness.policy import own, solved
from harness.policy.alpha import AlphaVectorPolicy
from harness.policy.base import Policy
from harness.policy.fsc import FileController, read_controller
from harness.policy.graph import PolicyGraph
from harness.policy.heuristic import ACCURACY_DEFAULT, BELIEF_DEFAULT, AccuracyPolicy, BeliefPolicy
from harness.policy.julia import SUFFIX, JuliaPolicy
from harness.policy.planner import despot, pomcp
from harness.policy.program import stored_program
from harness.policy.rollout import SIMULATIONS_DEFAULT, RolloutPolicy
from harness.policy.simple import ExitPolicy, RandomLegalPolicy, RandomPolicy
from harness.policy.team import TeamPolicy, policy_of, stored_team
from harness.policy.thresholds import ThresholdsPolicy
from harness.policy.thresholds import parse as parse_thresholds
from harness.program import parse, words_of
from harness.solver.solution import GRAPH_KIND, OWN, read

__all__ = [
    "Policy",
    "check_engine",
    "check_from_data",
    "default_specs",
    "make",
    "make_from_data",
    "named",
    "names_code",
    "specs",
]

MOST_SIMULATIONS = 1_000_000
"""What ``rollout`` simulates of each action at most: a step then takes minutes, in which no Ctrl-C is heard."""

LARGE = 1_000_000
"""States beyond which a table has rows of the online planners: what is smaller is solved."""

SOLVED = ("qmdp", "sarsop", "native-sarsop")
EVOLVED = {"ge": "evolved by the paper's grammar", "ge-feedback": "evolved by a grammar with feedback"}
"""Programs of our own runs, kept with the package where there is one for a domain."""


@dataclass(frozen=True)
class _Kind:
    """A way to name a policy: ``word`` or ``word:ARGUMENT``."""

    word: str
    help: str
    make: Callable[[Domain, str], Policy]
    argument: str = ""
    """The default argument; empty where there is none."""
    layout: str = ""
    """The only layout kind it works on; empty for any."""
    needs_file: bool = False
    """Whether it is written ``word:FILE``."""
    optional: bool = False
    """Whether an argument may be given although there is no default one."""
    agents: bool = False
    """Whether it needs a domain with agents."""
    listed: str = "always"
    """Whether the baseline table has a row of it: ``always``, on ``large`` domains only, or ``never``."""

    def suits(self, domain: Domain) -> bool:
        return self.layout in ("", domain.layout["kind"]) and (bool(domain.agents) or not self.agents)

    @property
    def spec(self) -> str:
        argument = "POLICY,POLICY" if self.agents else "FILE" if self.needs_file else self.argument
        return f"{self.word}:{argument}" if argument else self.word


def _threshold(text: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise PolicyError(f"{what} takes a threshold between 0.5 and 1, not {quoted(text)}") from None
    if not 0.5 <= value <= 1:
        raise PolicyError(f"{what} takes a threshold between 0.5 and 1; {quoted(value)} is out of range")
    return value


def _rollout(domain: Domain, text: str) -> Policy:
    if not text.isdecimal() or len(text) > 9 or not 1 <= int(text) <= MOST_SIMULATIONS:
        raise PolicyError(
            f"rollout takes a number of simulations an action, from 1 to {MOST_SIMULATIONS:,}, not {quoted(text)}"
        )
    return RolloutPolicy(domain, int(text))


def _from_file(domain: Domain, text: str) -> Policy:
    if not text:
        raise PolicyError("alpha needs a file: alpha:FILE, as written by `harness solve`")
    return AlphaVectorPolicy(domain, read(Path(text), domain))


def _program(domain: Domain, text: str) -> Policy:
    if not text:
        raise PolicyError("program needs a file: program:FILE, a script in the program language")
    source = files.read_source(Path(text), PolicyError)
    return policy_of(parse(source, words_of(domain), source=text))


def _controller(domain: Domain, text: str) -> Policy:
    if not text:
        raise PolicyError("fsc needs a file: fsc:FILE.json, a finite-state controller")
    return FileController(domain, read_controller(Path(text), domain))


MEMBERS = ("random", "program", "fsc")
"""Kinds of policies that get by on what one agent sees; others look at the belief, or plan with the model."""
TEAM = "team"
"""A policy for each agent; by itself the team that is kept with the package, where there is one for a domain."""


def _team(domain: Domain, text: str) -> Policy:
    if not text:
        path = registry.stored_program(domain, TEAM)
        if path is None:
            raise PolicyError(f"no team is kept for {domain.name}; name one, as in team:program:FILE,program:FILE")
        return stored_team(path, domain)
    specs = text.split(",")
    if len(specs) != len(domain.agents):
        agents = ", ".join(agent.name for agent in domain.agents)
        raise PolicyError(f"a team on {domain.name} is a policy for each of {agents}, not {quoted(text)}")
    return TeamPolicy(domain, [_member(spec, local_view(domain, i)) for i, spec in enumerate(specs)])


def _member(spec: str, view: Domain) -> Policy:
    word = spec.partition(":")[0]
    if word not in MEMBERS and not own.is_path(spec) and spec not in own.installed():
        raise PolicyError(f"no agent of a team can play {quoted(spec)}: {', '.join(MEMBERS)}, or code of yours")
    return make(spec, view)[1]


def _solved(word: str) -> Callable[[Domain, str], Policy]:
    def build(domain: Domain, text: str) -> Policy:
        path = registry.stored_policy(domain, word)
        if path is None:
            raise PolicyError(
                f"no {word} policy is stored for {domain.name}; solve it (harness solve {domain.name} --solver {word}) "
                f"and name the file: alpha:FILE"
            )
        return AlphaVectorPolicy(domain, read(path, domain))

    return build


def _graph(domain: Domain, text: str) -> Policy:
    if not text:
        raise PolicyError("graph needs a file: graph:FILE, as written by `harness solve`")
    return PolicyGraph(domain, read(Path(text), domain, GRAPH_KIND))


def _evolved(word: str) -> Callable[[Domain, str], Policy]:
    def build(domain: Domain, text: str) -> Policy:
        path = registry.stored_program(domain, word)
        if path is None:
            raise PolicyError(
                f"no {word} program is kept for {domain.name}; evolve one (harness evolve {domain.name} --out DIR) "
                f"and name it: program:DIR/best.txt"
            )
        return policy_of(stored_program(path, domain))

    return build


_KINDS = (
    _Kind("random", "uniform over all actions", lambda d, _: RandomPolicy()),
    _Kind("random-legal", "uniform over the legal actions", lambda d, _: RandomLegalPolicy()),
    _Kind("exit", "always right", lambda d, _: ExitPolicy(d), layout="rocksample"),
    _Kind("rollout", "best action by N simulations of random-legal each", _rollout, str(SIMULATIONS_DEFAULT)),
    _Kind(
        pomcp.WORD,
        "tree search by N simulations (time=100ms: as many as fit; exploration=X,rollout=legal|preferred,depth=N)",
        pomcp.make,
        str(pomcp.SIMULATIONS),
        listed="large",
    ),
    _Kind(
        despot.WORD,
        "search of a tree over N scenarios, between bounds (trials=N, or time=100ms; lambda=X,depth=N)",
        despot.make,
        str(despot.SCENARIOS),
        listed="never",  # the table of its upper bound takes a minute where a domain is large
    ),
    _Kind(
        "accuracy",
        "paper's Algorithm 2, threshold λ",
        lambda d, text: AccuracyPolicy(d, _threshold(text, "accuracy")),
        f"{ACCURACY_DEFAULT}",
        "rocksample",
    ),
    _Kind(
        "belief",
        "paper's Algorithm 3, threshold γ",
        lambda d, text: BeliefPolicy(d, _threshold(text, "belief")),
        f"{BELIEF_DEFAULT}",
        "rocksample",
    ),
    _Kind(
        "thresholds",
        "most belief a step, read from near enough (accept=X,reject=X,ahead=X,aside=X,wait=X)",
        lambda d, text: ThresholdsPolicy(d, **parse_thresholds(text)),
        layout="rocksample",
        optional=True,
    ),
    *(_Kind(word, what, _evolved(word)) for word, what in EVOLVED.items()),
    *(_Kind(word, f"alpha vectors solved by {word} in Julia", _solved(word)) for word in SOLVED),
    _Kind(
        OWN, "what earns the lower bound of harness solve (solved:10s solves on the way)", solved.make, optional=True
    ),
    _Kind("alpha", "alpha vectors of a file written by harness solve --solver", _from_file, needs_file=True),
    _Kind("graph", "a policy graph of a file written by harness solve", _graph, needs_file=True),
    _Kind("fsc", "a finite-state controller of a JSON file, or PAYNT's", _controller, needs_file=True),
    _Kind("program", "a script in the program language", _program, needs_file=True),
    _Kind(TEAM, "a policy for each agent, as in team:program:FILE,fsc:FILE", _team, needs_file=True, agents=True),
)


def _usable(domain: Domain) -> list[_Kind]:
    """The kinds that mean something on a domain; solved and evolved ones where there is one with the package."""
    kept = [word for word in (*SOLVED, OWN) if registry.stored_policy(domain, word)]
    kept += [word for word in EVOLVED if registry.stored_program(domain, word)]
    return [
        kind
        for kind in _KINDS
        if kind.suits(domain) and (kind.word in kept or kind.word not in (*SOLVED, OWN, *EVOLVED))
    ]


def specs(domain: Domain) -> dict[str, str]:
    """Policy strings that mean something on a domain, each with what it does."""
    return {
        **{kind.spec: kind.help for kind in _usable(domain)},
        **({TEAM: "the team kept with the package"} if registry.stored_program(domain, TEAM) else {}),
        **{name: f"of an installed package, {point.value}" for name, point in own.installed().items()},
        "FILE.py:NAME": "a class or function of yours; MODULE:NAME likewise",
        f"FILE{SUFFIX}": "a policy or solver of POMDPs.jl, on the engine julia",
    }


def default_specs(domain: Domain) -> list[str]:
    """The policies of the domain's baseline table."""
    listed = ("always", "large") if domain.n_states > LARGE else ("always",)
    found = [kind.spec for kind in _usable(domain) if not kind.needs_file and kind.listed in listed]
    return [*found, TEAM] if registry.stored_program(domain, TEAM) else found


def make(spec: str, domain: Domain) -> tuple[str, Policy]:
    """The policy that a string names, and the string with its defaults filled in.

    Raises:
        PolicyError: the string means nothing on this domain, or its parameter is out of range.
        SnapshotError: a policy file is damaged or belongs to another model.
    """
    if _is_julia(spec):
        return spec, JuliaPolicy(domain, Path(spec))
    word, colon, text = spec.partition(":")
    kinds = {kind.word: kind for kind in _KINDS}
    if word not in kinds:
        return spec, _own(spec, domain)
    kind, known = kinds[word], ", ".join(specs(domain))
    if not kind.suits(domain):
        needed = "domain with agents" if kind.agents else f"{kind.layout} domain"
        raise PolicyError(f"policy {quoted(word)} needs a {needed}, {domain.name} is none (there: {known})")
    if colon and not kind.argument and not kind.needs_file and not kind.optional:
        raise PolicyError(f"policy {quoted(word)} takes no parameter, but {quoted(spec)} gives one")
    argument = text if colon else kind.argument
    return (f"{word}:{argument}" if argument else word), kind.make(domain, argument)


def _own(spec: str, domain: Domain) -> Policy:
    if "\n" in spec or spec.endswith(")"):
        raise PolicyError(
            f"{quoted(spec)} is no policy string; if it is a program, write it into a file and name that: program:FILE"
        )
    if own.is_path(spec) and own.is_there(spec):
        return own.load(spec, domain)
    if spec in (found := own.installed()):
        return own.load_installed(found[spec], domain)
    hint = nearest(spec.partition(":")[0], [*(kind.word for kind in _KINDS), *found])
    raise PolicyError(f"no policy {quoted(spec)}{hint} (on {domain.name}: {', '.join(specs(domain))})")


def _is_julia(spec: str) -> bool:
    return spec.endswith(SUFFIX) and "\n" not in spec and all(kind.word != spec.partition(":")[0] for kind in _KINDS)


def check_engine(policy: str | Policy | None, engine: str) -> None:
    """Make sure that a policy, which need not have been made yet, plays on an engine.

    Raises:
        PolicyError: it is a Julia file, and the engine is another than ``julia``.
    """
    needed = "julia" if isinstance(policy, str) and _is_julia(policy) else getattr(policy, "engine", engine)
    if needed != engine:
        name = quoted(policy) if isinstance(policy, str) else type(policy).__name__
        raise PolicyError(f"{name} plays on the engine {needed}, not on {engine}; see `harness julia`")


def names_code(spec: str) -> bool:
    """Whether a policy string is the path of code, and no policy of the harness's."""
    return _is_julia(spec) or (own.is_path(spec) and all(kind.word != spec.partition(":")[0] for kind in _KINDS))


def check_from_data(spec: str, allow_code: bool = False) -> None:
    """Make sure that a policy string which stands in data (a table, a list of scores, a run's record) names no file.

    Data never decides which files are read or run: only what the user wrote does, or his word that he trusts the data.

    Raises:
        PolicyError: it names one, and ``allow_code`` is False; the message says what would be read or run.
    """
    (word, colon, _), code = spec.partition(":"), names_code(spec)
    if (code or any(kind.word == word and kind.needs_file and colon for kind in _KINDS)) and not allow_code:
        raise PolicyError(registry.refusal(spec, "run" if code else "read"))


def make_from_data(spec: str, domain: Domain, allow_code: bool = False) -> tuple[str, Policy]:
    """:func:`make` for a string that stands in data, after :func:`check_from_data`."""
    check_from_data(spec, allow_code)
    return make(spec, domain)


def named(policy: str | Policy, domain: Domain) -> tuple[str, Policy]:
    """A policy and the name that tables show, from a policy string or from any object with ``reset`` and ``act``.

    Raises:
        PolicyError: the string means nothing on this domain, or the object is no policy.
    """
    if isinstance(policy, str):
        return make(policy, domain)
    name = str(getattr(policy, "name", type(policy).__name__))
    if isinstance(policy, type) or not isinstance(policy, Policy):
        raise PolicyError(f"{name} is no policy: an object with the methods reset(batch) and act(batch) is needed")
    return name, policy
