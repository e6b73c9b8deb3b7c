"""Names of the environments."""

from __future__ import annotations

import gymnasium

from harness import registry
from harness.model.domain import Domain

NAMESPACE = "pomdp_harness"
_SPELLINGS = {
    "fieldvision-rocksample": "FieldVisionRockSample",
    "rocksample": "RockSample",
    "bordercross": "BorderCross",
    "dec-bordercross": "DecBorderCross",
    "heaven-hell": "HeavenHell",
    "tiger-grid": "TigerGrid",
}


def environment_id(domain: Domain) -> str:
    """The id of a domain of the registry: ``pomdp_harness/RockSample-7x8-v1``; the version is the domain's."""
    spelled = (
        name + domain.name.removeprefix(word) for word, name in _SPELLINGS.items() if domain.name.startswith(word)
    )
    name = next(spelled, domain.name.capitalize()).replace("@", "-")  # which Gymnasium does not take
    return f"{NAMESPACE}/{name}-v{domain.version}"


def register() -> None:
    """Register every domain that ships with the package; those that are registered already stay as they are."""
    for name in registry.names():
        known = environment_id(registry.load(name))
        if known not in gymnasium.registry:
            gymnasium.register(
                known,
                entry_point="harness.gym.single:PomdpEnv",
                vector_entry_point="harness.gym.vector:PomdpVectorEnv",
                kwargs={"domain": name},
            )
