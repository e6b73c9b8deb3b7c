"""What a policy sees: a batch of E episodes, the hidden states left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from harness.engine import rng
from harness.errors import PolicyError
from harness.model.domain import Domain
from harness.model.tables import Tables, compiled, is_legal

_T = TypeVar("_T", bound=np.generic)


@dataclass
class Batch:
    """A batch of episodes as policies see it. All arrays have E rows, are read-only and change with every step.

    The hidden state is not here, and neither are the engine's random numbers.
    """

    domain: Domain
    visible: NDArray[np.int32]
    """(E,) index of the visible part; ``domain.visible_values[visible]`` says what it stands for."""
    observation: NDArray[np.int32]
    """(E,) index of the last observation; −1 before the first one of a domain without an initial reading."""
    marginals: NDArray[np.float64]
    """(E, N) belief: probabilities of the values of every hidden factor, one factor after the other. (E, 0) for a
    policy with ``uses_belief = False``."""
    done: NDArray[np.bool_]
    """(E,) whether the episode has ended; actions of ended episodes are ignored."""
    seed: int
    first: int
    """Number of the batch's first episode."""
    step: int = 0
    """Steps taken so far."""

    @property
    def size(self) -> int:
        """Number E of episodes."""
        return len(self.done)

    @property
    def features(self) -> NDArray[np.float64]:
        """(E, F) the domain's belief features, for RockSample P(rock i is good)."""
        return self.tracked()[:, self.domain.feature_columns]

    def tracked(self) -> NDArray[np.float64]:
        """:attr:`marginals`, for whoever cannot do without: compiled code would read past what is not there.

        Raises:
            PolicyError: the engine left the belief out.
        """
        if self.marginals.shape[1] != self.domain.n_marginals:
            raise PolicyError("the belief was left out (uses_belief = False), but the policy looks at it: say True")
        return self.marginals

    def joint(self, episodes: NDArray[np.intp] | slice = slice(None)) -> NDArray[np.float64]:
        """(E, H) joint belief over the hidden factors, the last factor varying fastest."""
        return joint(self.domain, self.tracked()[episodes])

    def legal(self) -> NDArray[np.bool_]:
        """(E, A) actions that cost no illegal-move penalty, as far as the belief can tell; all False once done."""
        mask = np.zeros((self.size, self.domain.n_actions), dtype=np.bool_)
        _legal(self.domain.tables, self.domain.legality, self.visible, self.tracked(), self.done, mask)
        return mask

    def uniform(self, stream: int = 0) -> NDArray[np.float64]:
        """(E,) random numbers in [0, 1) for the policy's own choices at this step.

        They depend on the seed, the step and the episode only, and are independent of the engine's. A policy that
        needs several numbers a step asks for ``stream`` 0, 1, 2, …
        """
        return rng.uniforms(self.seed, rng.POLICY + stream, self.step, self.first, self.size)


def joint(domain: Domain, marginals: NDArray[np.float64]) -> NDArray[np.float64]:
    """(E, H) joint beliefs of marginals (E, N), the last factor varying fastest."""
    offset = domain.factor_offset
    product = np.ones((len(marginals), 1))
    for k in range(len(offset) - 1):
        factor = marginals[:, None, offset[k] : offset[k + 1]]
        product = (product[:, :, None] * factor).reshape(len(marginals), -1)
    return product


def read_only(array: NDArray[_T]) -> NDArray[_T]:
    """A view of the array that cannot be written through."""
    view = array.view()
    view.flags.writeable = False
    return view


@compiled
def _legal(
    t: Tables,
    legality: NDArray[np.int8],
    visible: NDArray[np.int32],
    marginals: NDArray[np.float64],
    done: NDArray[np.bool_],
    mask: NDArray[np.bool_],
) -> None:
    choices, rows, factor_offset, n_actions = t.choices, t.rows, t.factor_offset, t.n_actions
    for e in range(len(visible)):
        if not done[e]:
            for a in range(n_actions):
                mask[e, a] = legality[visible[e], a] == 1
                if legality[visible[e], a] < 0:
                    mask[e, a] = is_legal(choices, rows, factor_offset, visible[e] * n_actions + a, marginals, e)
