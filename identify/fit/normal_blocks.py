"""Normal equations of many decays at one point of the unknowns.

The runs of a mass state differ only in their samples and initial states: everything that belongs to
the model is computed once, and numbers of one kind are arrays whose first axis is the decay.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ..decays.decay import FreeDecay
from .products import Products
from .varpro import (
    Evaluated,
    LinearPart,
    NormalBlock,
    linear_coefficients,
    pseudo_inverse,
    slopes,
)

_N = 14  # states of the vehicle


def blocks_of(
    points: Mapping[str, Evaluated],
    decays: Sequence[FreeDecay],
    seen: Sequence[Sequence[Products]],
) -> list[tuple[NormalBlock, LinearPart]]:
    """Return the share of each decay in the normal equations, and its fitted linear part.

    `points`: the model, for each mass state.  `seen`: products of each decay (`products_of`).
    """
    alike: dict[tuple[object, ...], list[int]] = {}
    for d, decay in enumerate(decays):
        groups = tuple(points[decay.mass_state].box.groups.index(r.group) for r in decay.recordings)
        alike.setdefault((decay.mass_state, *groups), []).append(d)
    found: dict[int, tuple[NormalBlock, LinearPart]] = {}
    for members in alike.values():
        first = decays[members[0]]
        blocks = _together(points[first.mass_state], first, [seen[d] for d in members])
        found |= dict(zip(members, blocks, strict=True))
    return [found[d] for d in range(len(decays))]


def _together(
    at: Evaluated, first: FreeDecay, seen: Sequence[Sequence[Products]]
) -> Iterator[tuple[NormalBlock, LinearPart]]:
    """Yield the shares and linear parts of decays with the same channels as the first."""
    stacks = linear_coefficients(at, first)
    n, size, P = len(seen), stacks[0].shape[-1], len(at.box.prior_sigma)
    normal, right, cost = np.zeros((n, size, size)), np.zeros((n, size)), np.zeros(n)
    parts = []
    for i, (recording, stack) in enumerate(zip(first.recordings, stacks, strict=True)):
        weight = at.weights(recording.group)
        gram = np.stack([one[i].gram for one in seen])[:, None]  # (n, 1, m, m)
        cross = np.stack([one[i].cross.T for one in seen])  # (n, n_channels, m)
        weighted = (stack * weight[:, None, None]).reshape(-1, size)
        normal += weighted.T @ (gram @ stack).reshape(n, -1, size)
        right += cross.reshape(n, -1) @ weighted
        cost += np.stack([one[i].power for one in seen]) @ weight
        parts.append((recording.group, stack, weight, weighted, gram, cross))
    inverse = pseudo_inverse(normal)
    solution = (inverse @ right[..., None])[..., 0]
    z = solution[:, :_N] @ at.modes.W.T
    H, mixed, g = np.zeros((n, P, P)), np.zeros((n, size, P)), np.zeros((n, P))
    for group, stack, weight, weighted, gram, cross in parts:
        fitted = np.moveaxis(stack @ solution.T, 2, 0)  # (n, n_channels, m)
        left = cross - (fitted[:, :, None] @ gram)[:, :, 0]
        J = slopes(at, group, z)  # (n, n_channels, 28, P)
        k = J.shape[2]
        GJ = gram[..., :k] @ J
        by_weight = (J * weight[:, None, None]).reshape(n, -1, P)
        cost -= np.sum(fitted * (cross + left), axis=2) @ weight
        H += by_weight.swapaxes(1, 2) @ GJ[:, :, :k].reshape(n, -1, P)
        mixed += weighted.T @ GJ.reshape(n, -1, P)
        g += (left[:, :, :k].reshape(n, 1, -1) @ by_weight)[:, 0]
    H -= mixed.swapaxes(1, 2) @ inverse @ mixed
    for i, one in enumerate(seen):
        linear = LinearPart(tuple(one), stacks, inverse[i], solution[i])
        yield NormalBlock(float(cost[i]), H[i], g[i]), linear
