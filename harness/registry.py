"""What ships with the package: snapshots of the named domains, and the policies solved for them."""

from __future__ import annotations

import functools
from pathlib import Path

from harness import bridge, formats
from harness.errors import HarnessError, nearest, quoted
from harness.model import domain
from harness.model.domain import Domain

DATA = Path(__file__).resolve().parent / "data"


def names() -> list[str]:
    """Names of the domains that ship with the package."""
    return sorted(path.stem for path in (DATA / "snapshots").glob("*.npz"))


def load(name: str | Path) -> Domain:
    """A domain: by the name of a shipped one, or from a file.

    A file is a snapshot (``.npz``), a model file (``.pomdp``, ``.pomdpx``, or these with ``.gz``), or a Julia file
    (``.jl``), which must end in a POMDPs.jl model; it is run in Julia, which must be set up.

    Raises:
        HarnessError: there is no such domain, or the file is damaged.
    """
    path = Path(name)
    if str(name) in names():  # first, for one of them ends in .jl
        return _shipped(str(name))
    if path.suffix == ".jl":
        return bridge.from_file(path)
    if path.suffix == ".npz":
        return domain.read(path)
    if formats.is_model_file(path):
        return formats.load(path)
    raise HarnessError(
        f"no domain {quoted(name)}{nearest(str(name), names())} "
        "(`harness domains` lists them; or a file: .npz, .pomdp, .pomdpx, .jl)"
    )


def load_from_data(name: str, allow_code: bool = False) -> Domain:
    """:func:`load` for a name that stands in data (a table, a list of scores, a run's record).

    Data never decides which files are read or run: only what the user wrote does, or his word that he trusts the data.

    Raises:
        HarnessError: it names a file, and ``allow_code`` is False; or as :func:`load`.
    """
    path = Path(name)
    if not allow_code and name not in names() and (path.suffix in (".jl", ".npz") or formats.is_model_file(path)):
        raise HarnessError(refusal(name, "run" if path.suffix == ".jl" else "read"))
    return load(name)


def refusal(name: str, what: str) -> str:
    """Why a name that stands in data is not followed; ``what`` would be done: ``read`` or ``run``."""
    return f"{quoted(name)} names a file, which would be {what}: only with --allow-code (allow_code=True) is it"


@functools.cache
def _shipped(name: str) -> Domain:
    return domain.read(snapshot_path(name))


def ships(domain: Domain) -> bool:
    """Whether a domain is one of the package's, whatever its shaping, and does not only bear the name of one."""
    return domain.name in names() and domain.model_hash == _shipped(domain.name).model_hash


def stored_policy(domain: Domain, policy: str) -> Path | None:
    """Where a solved policy that ships for a domain lies; None where none does."""
    path = policy_path(domain.name, policy)
    return path if path.exists() and ships(domain) else None


def stored_program(domain: Domain, policy: str) -> Path | None:
    """Where an evolved program that ships for a domain lies; None where none does."""
    path = program_path(domain.name, policy)
    return path if path.exists() and ships(domain) else None


def snapshot_path(name: str) -> Path:
    """Where the snapshot of a named domain lies in the package."""
    return DATA / "snapshots" / f"{name}.npz"


def policy_path(domain_name: str, policy: str) -> Path:
    """Where a solved policy of a named domain lies in the package."""
    return DATA / "policies" / domain_name / f"{policy}.npz"


def program_path(domain_name: str, policy: str) -> Path:
    """Where an evolved program of a named domain lies in the package."""
    return DATA / "programs" / domain_name / f"{policy}.json"


def grammar_path(name: str) -> Path:
    """Where a grammar that ships with the package lies: in a checkout beside the package, in a wheel inside it."""
    checkout = DATA.parent.parent / "grammars"
    return (checkout if checkout.is_dir() else DATA / "grammars") / f"{name}.bnf"
