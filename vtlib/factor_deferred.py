"""The same update of large Cholesky factors at about a third of the cost: most of it put off."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import pad

from vtlib.gaussian import Precision

AHEAD = 8  # iterations whose noise is drawn at once, after which what was put off is applied
PANEL = 64  # the diagonal blocks, kept up to date at each step, are about this wide
STRIP = 4  # panels that are multiplied with noise at once
LEAST_SCALE = 0.25  # a smaller running factor on L is applied at once, before digits are lost
LARGEST = torch.finfo(torch.float32).max
LOOSE = 0.01  # of the clip; if a bound on the KL's part is larger, the largest entry is looked up
ROUNDING = 2**-26  # a smaller part of a number is lost when it is taken off in float32
MANY = 0.04  # of a member's rows: if clipping may bind in more, its whole gradient is written out


class _Rows(NamedTuple):
    """What a clipped step adds to rows of member m, left of the diagonal, and sets on it.

    panel, at (n,): where the rows lie. change: (P, n, width). diagonal: (n,).
    """

    m: int
    panel: Tensor
    at: Tensor
    change: Tensor
    diagonal: Tensor


class _Whole(NamedTuple):
    """Outer products (P, n, width) that member m keeps to itself, and its blocks (P, width, width).

    The blocks are those on the diagonal of L before the step.
    """

    m: int
    left: Tensor
    blocks: Tensor


class DeferredFactors:
    """Lower-triangular factors L (M, d, d) of M Gaussians under plain SGD, as `CholeskyFactors`.

    Reading and writing L is most of that update's work. Here only the diagonal blocks of L are kept
    up to date. Below them L is scale * (low + U V^T), with one column of U and of V for each outer
    product since the last ``look_ahead``; that applies them in one matrix product, and multiplies
    L with the noise of the iterations to come while it reads it. What later outer products add to
    L z follows from U and V, panel by panel. Exact, but for rounding. The given L is not changed.
    """

    ahead = AHEAD

    _scale: float
    _pending: int  # columns of U and V in use
    _U: Tensor
    _V: Tensor
    _below: Tensor  # what W^T L owes to the blocks below the diagonal
    _largest: float  # no entry of L is larger
    _noted: set[int]  # members with columns other than zero
    _stale: set[int]  # members for which ``_ahead`` has to be looked up anew at each draw
    _ahead: Tensor | None  # low z for the noise to come, None until it is asked for

    def __init__(
        self, L: Tensor, precision: Precision, alpha: float, sigma_min: float, clip: float
    ) -> None:
        self._precision = precision
        self._alpha, self._sigma_min, self._clip = alpha, sigma_min, clip
        self._most = min(alpha * clip, LARGEST)  # that a step may change an entry by
        self._count, self._d = L.shape[0], L.shape[-1]
        self._panels = max(1, round(self._d / PANEL))
        self._width = -(-self._d // self._panels)
        self._padded = self._panels * self._width
        scale, W = precision
        # the precision is scale * I minus the outer products of these
        self._columns = None if W is None else self._blocks(W.transpose(1, 2) * scale**0.5)
        self._set(L)

    @property
    def L(self) -> Tensor:
        """The factors (M, d, d), as a copy."""
        self._apply()
        whole = self._low.clone()
        current = self._diag.unflatten(0, (self._count, self._panels)).permute(0, 2, 3, 1)
        self._diagonal_blocks(whole).copy_(current)
        return whole[:, : self._d, : self._d]

    def look_ahead(self, noise: Tensor) -> None:
        """Make ready for ``product`` with each of B draws of noise (B, M, k, d)."""
        self._apply()
        self._noise = self._blocks(noise)

    def product(self, at: int) -> Tensor:
        """L z (M, k, d) with the present L, for the draw ``at`` of the last ``look_ahead``."""
        ahead = self._ahead
        if ahead is None:
            ahead = self._low_times(self._noise, slice(None))
            self._ahead, self._stale = ahead, set()
        for m in self._stale:
            alone = slice(m, m + 1)
            ahead[at, m] = self._low_times(self._noise[at : at + 1, alone], alone)[0, 0]
        z = self._noise[at].flatten(0, 1)
        out = torch.bmm(z, self._diag.transpose(1, 2)).unflatten(0, (self._count, self._panels))
        out.add_(ahead[at], alpha=self._scale)
        if self._pending:
            out.add_(self._put_off_times(z), alpha=self._scale)
        return self._rows(out, self._d)

    def step(self, gradients: Tensor, noise: Tensor, kl_weight: float) -> None:
        """One SGD step; the TD part of the gradient is sum_k gradients_k noise_k^T, (M, n, d)."""
        over = self._rows_that_may_clip(gradients, noise, kl_weight)
        pull = self._alpha * kl_weight
        shrink = 1 - pull * self._precision.scale
        left, right = self._blocks(gradients * -self._alpha), self._blocks(noise)
        if self._columns is not None:
            left = torch.cat([left, self._columns * pull], 2)
            right = torch.cat([right, self._columns_times_L(self._columns)], 2)
        few, many = _few_and_many(over)
        changes = [self._clip_rows(m, over[m], left, right, shrink, pull) for m in few]
        wholes = [self._take_out(m, left) for m in many]
        self._step_diagonal(left, right, shrink, pull)
        self._put_off(left, right, shrink, many)
        for rows in changes:
            self._add_rows(rows)
        for whole in wholes:
            self._write_out(whole, right, shrink, pull)

    def _step_diagonal(self, left: Tensor, right: Tensor, shrink: float, pull: float) -> None:
        diagonal = self._diag.diagonal(dim1=1, dim2=2)
        push = pull / diagonal
        self._diag.baddbmm_(left.flatten(0, 1).transpose(1, 2), right.flatten(0, 1), beta=shrink)
        self._diag.tril_()
        diagonal.add_(push).clamp_(min=self._sigma_min)

    def _put_off(self, left: Tensor, right: Tensor, shrink: float, none: Sequence[int]) -> None:
        """Note the outer products (M, P, n, width) of a step for the blocks below the diagonal.

        Those of some members are all zero.
        """
        if self._columns is not None:
            later = _sums_after(self._columns @ left.transpose(2, 3))
            self._below.mul_(shrink).add_(later @ right)
        added = left.shape[2]
        if not len(self._U):
            shape = self._count, self._panels, AHEAD * added, self._width
            self._U, self._V = left.new_empty(shape), left.new_empty(shape)
        if self._scale * shrink < LEAST_SCALE or self._pending + added > self._U.shape[2]:
            self._apply(shrink)
        else:
            self._scale *= shrink
        span = slice(self._pending, self._pending + added)
        self._U[:, :, span] = left / self._scale
        self._V[:, :, span] = right
        self._pending += added
        self._noted |= set(range(self._count)) - set(none)

    def _put_off_times(self, z: Tensor) -> Tensor:
        """What the noted outer products add to L z, in blocks (M, P, k, width)."""
        U, V = (x.flatten(0, 1)[:, : self._pending] for x in (self._U, self._V))
        along = torch.bmm(z, V.transpose(1, 2)).unflatten(0, (self._count, self._panels))
        before = along.cumsum(1).sub_(along)
        added: Tensor = torch.bmm(before.flatten(0, 1), U).unflatten(0, before.shape[:2])
        return added

    def _apply(self, shrink: float = 1.0) -> None:
        """Bring the blocks below the diagonal up to date, times a factor."""
        factor = self._scale * shrink
        if self._pending:
            right = self._rows(self._V[:, :, : self._pending], self._padded)
            for panel in range(1, self._panels):
                edge = panel * self._width
                low = self._low[:, edge : edge + self._width, :edge]
                left = self._U[:, panel, : self._pending].transpose(1, 2)
                low.baddbmm_(left, right[:, :, :edge], beta=factor, alpha=factor)
        elif factor != 1.0:
            self._low.mul_(factor)
        self._scale, self._pending, self._ahead = 1.0, 0, None
        self._noted, self._stale = set(), set()

    def _low_times(self, noise: Tensor, members: slice) -> Tensor:
        """low z of some members for noise (B, M', P, k, width), in such blocks."""
        low = self._low[members]
        draws, _, _, k, _ = noise.shape
        flat = noise.permute(1, 0, 3, 2, 4).reshape(len(low), draws * k, self._padded)
        out = torch.empty_like(flat)
        for start in range(0, self._padded, STRIP * self._width):
            end = min(start + STRIP * self._width, self._padded)
            out[:, :, start:end] = torch.bmm(flat[:, :, :end], low[:, start:end, :end].mT)
        shape = len(low), draws, k, self._panels, self._width
        return out.view(shape).permute(1, 0, 3, 2, 4).contiguous()

    def _columns_times_L(self, columns: Tensor) -> Tensor:
        """W^T L times the root of the precision's scale, in blocks (M, P, r, width)."""
        current = torch.bmm(columns.flatten(0, 1), self._diag)
        product: Tensor = current.unflatten(0, columns.shape[:2])
        return product.add_(self._below)

    def _rows_that_may_clip(self, gradients: Tensor, noise: Tensor, kl_weight: float) -> Tensor:
        """Rows (M, d) of L whose gradient could exceed the clip, by bounds that cost O(n d).

        (M, 1), if there are none.
        """
        sizes, reach = gradients.abs(), noise.abs().amax(-1)
        td = float((sizes.amax(-1) * reach).sum(-1).max())
        # a column of L meets all of W W^T
        wide = 1.0 if self._precision.W is None else self._d**0.5
        pull = kl_weight * self._precision.scale * wide
        if pull * self._largest > LOOSE * self._clip:
            self._largest = float(self.L.abs().max())
        kl = kl_weight / self._sigma_min + pull * self._largest
        # an upper bound on the entries from here on, without reading L
        self._largest += self._alpha * min(td + kl, self._clip)
        if td + kl <= self._clip:
            return torch.zeros(sizes.shape[0], 1, dtype=torch.bool)
        return ~((sizes * reach.unsqueeze(-1)).sum(1) + kl <= self._clip)

    def _clip_rows(
        self, m: int, over: Tensor, left: Tensor, right: Tensor, shrink: float, pull: float
    ) -> _Rows:
        """Take rows of a member out of the step's outer products; what to add to them instead."""
        row = over.nonzero().flatten()
        panel, at = row // self._width, row % self._width
        L = self._rows_of_L(m, panel, at)
        step = left[m][panel, :, at] @ right[m]
        left[m, panel, :, at] = 0.0
        step.add_(L, alpha=shrink - 1)
        own = panel, torch.arange(len(row)), at
        step[own] += pull / L[own]
        step.clamp_(-self._most, self._most)
        diagonal = (L[own] + step[own]).clamp_(min=self._sigma_min)
        columns = torch.arange(self._padded).view(self._panels, 1, self._width)
        change = step.add_(L, alpha=1 - shrink).mul_(columns < row.unsqueeze(-1))
        return _Rows(m, panel, at, change, diagonal)

    def _rows_of_L(self, m: int, panel: Tensor, at: Tensor) -> Tensor:
        """Rows of one member's L, in blocks (P, rows, width)."""
        low = self._low[m, panel * self._width + at]
        rows: Tensor = low.unflatten(-1, (self._panels, self._width)).transpose(0, 1)
        if self._pending:
            U, V = (x[m][:, : self._pending] for x in (self._U, self._V))
            rows = rows + U[panel, :, at] @ V
        below = torch.arange(self._panels).unsqueeze(-1) < panel
        rows = (rows * self._scale).mul_(below.unsqueeze(-1))
        blocks = self._diag.unflatten(0, (self._count, self._panels))
        rows[panel, torch.arange(len(at))] = blocks[m, panel, at]
        return rows

    def _add_rows(self, rows: _Rows) -> None:
        """Add to rows of one member's L below the diagonal, and set their diagonal entries."""
        m, panel, at, change, diagonal = rows
        blocks = self._diag.unflatten(0, (self._count, self._panels))
        blocks[m, panel, at] += change[panel, torch.arange(len(at))]
        blocks[m, panel, at, at] = diagonal
        below = torch.arange(self._panels).unsqueeze(-1) < panel
        change = change * below.unsqueeze(-1)
        if self._columns is not None:
            self._below[m] += self._columns[m][panel, :, at].T @ change
        change /= self._scale
        self._low[m, panel * self._width + at] += change.transpose(0, 1).flatten(1)
        if self._ahead is not None:
            later = (self._noise[:, m] @ change.transpose(1, 2)).sum(1)  # (B, k, rows)
            self._ahead[:, m][:, panel, :, at] += later.permute(2, 0, 1)

    def _take_out(self, m: int, left: Tensor) -> _Whole:
        """Take a member out of the step's outer products, and bring its L up to date."""
        if m in self._noted:
            right = self._rows(self._V[m : m + 1, :, : self._pending], self._padded)[0]
            for panel in range(1, self._panels):
                edge = panel * self._width
                low = self._low[m, edge : edge + self._width, :edge]
                low.addmm_(self._U[m, panel, : self._pending].T, right[:, :edge])
            self._U[m, :, : self._pending] = 0.0
            self._noted.discard(m)
        blocks = self._diag.unflatten(0, (self._count, self._panels))
        whole = _Whole(m, left[m].clone(), blocks[m].clone())
        left[m] = 0.0
        return whole

    def _write_out(self, whole: _Whole, right: Tensor, shrink: float, pull: float) -> None:
        """The step of one member with its gradient written out, a panel at a time."""
        m, left, diagonal_blocks = whole
        felt = 1 - shrink > ROUNDING
        bound, above = min(self._most / self._scale, LARGEST), left.mT / self._scale
        rows = self._rows(right[m : m + 1], self._padded)[0]
        owed = rows.new_zeros(0 if self._columns is None else self._columns.shape[2], self._padded)
        for panel in range(1, self._panels):
            edge = panel * self._width
            low = self._low[m, edge : edge + self._width, :edge]  # by now shrunk
            step = above[panel] @ rows[:, :edge]
            if felt:
                step.add_(low, alpha=(shrink - 1) / shrink)
                low.mul_(1 / shrink)
            low.add_(step.clamp_(-bound, bound))
            if self._columns is not None:
                owed[:, :edge].addmm_(self._columns[m, panel], low, alpha=self._scale)
        if self._columns is not None:
            self._below[m] = self._blocks(owed)
        step = left.mT @ right[m] + (shrink - 1) * diagonal_blocks
        diagonal = diagonal_blocks.diagonal(dim1=1, dim2=2)
        step.diagonal(dim1=1, dim2=2).add_(pull / diagonal)
        diagonal_blocks.add_(step.clamp_(-self._most, self._most)).tril_()
        diagonal.clamp_(min=self._sigma_min)
        self._diag.unflatten(0, (self._count, self._panels))[m] = diagonal_blocks
        self._stale.add(m)

    def _set(self, L: Tensor) -> None:
        """Take over new factors (M, d, d), with a diagonal of at least sigma_min."""
        extra = self._padded - self._d
        low = pad(L, (0, extra, 0, extra))
        blocks = self._diagonal_blocks(low)
        self._diag = blocks.permute(0, 3, 1, 2).flatten(0, 1).clone()
        self._diag.diagonal(dim1=1, dim2=2).clamp_(min=self._sigma_min)
        blocks.zero_()
        self._low = low
        self._scale, self._pending, self._ahead = 1.0, 0, None
        self._noted, self._stale = set(), set()
        self._U = self._V = L.new_empty(0)  # made when the first outer product is put off
        if self._columns is not None:
            self._below = self._blocks(self._rows(self._columns, self._padded) @ low)
        self._largest = max(float(self._low.abs().max()), float(self._diag.abs().max()))

    def _diagonal_blocks(self, matrix: Tensor) -> Tensor:
        """View (M, width, width, P) of the diagonal blocks of (M, padded, padded)."""
        shape = self._count, self._panels, self._width, self._panels, self._width
        return matrix.view(shape).diagonal(dim1=1, dim2=3)

    def _blocks(self, rows: Tensor) -> Tensor:
        """Vectors (..., k, up to padded) as blocks (..., P, k, width), padded with zeros."""
        wide = pad(rows, (0, self._padded - rows.shape[-1]))
        blocks: Tensor = wide.unflatten(-1, (self._panels, self._width))
        return blocks.transpose(-2, -3).contiguous()

    def _rows(self, blocks: Tensor, length: int) -> Tensor:
        """Blocks (M, P, k, width) as vectors (M, k, length)."""
        return blocks.transpose(1, 2).flatten(2)[:, :, :length]


def _sums_after(blocks: Tensor) -> Tensor:
    """For each panel (axis 1) the sum over all later ones."""
    return blocks.sum(1, keepdim=True) - blocks.cumsum(1)


def _few_and_many(over: Tensor) -> tuple[list[int], list[int]]:
    """The members with some marked rows in (M, d), and those with many."""
    shares = over.float().mean(1).tolist()
    few = [m for m, share in enumerate(shares) if 0 < share <= MANY]
    return few, [m for m, share in enumerate(shares) if share > MANY]
