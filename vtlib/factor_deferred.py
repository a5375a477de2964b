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


class _Step(NamedTuple):
    """A step's outer products left^T right, in blocks (M, P, n, width), and its pull to the prior.

    That takes shrink * L for L, and adds pull times the outer products of the precision's columns
    with pulled (M, P, r, width).
    """

    left: Tensor
    right: Tensor
    pulled: Tensor
    shrink: float
    pull: float


class _Whole(NamedTuple):
    """Outer products that member m keeps to itself, and its blocks (P, width, width).

    left: (P, n + r, width), right: (n + r, padded). The blocks are those on the diagonal of L
    before the step.
    """

    m: int
    left: Tensor
    right: Tensor
    blocks: Tensor


class DeferredFactors:
    """Lower-triangular factors L (M, d, d) of M Gaussians under plain SGD, as `CholeskyFactors`.

    Reading and writing L is most of that update's work. Here only the diagonal blocks of L are kept
    up to date. Below them L is scale * (low + U V^T), with one column of U and of V for each outer
    product since the last ``look_ahead``, after those of the precision, whose columns of V add up;
    that applies them in one matrix product, and multiplies L with the noise of the iterations to
    come while it reads it. What later outer products add to L z follows from U and V, panel by
    panel. Exact, but for rounding. The given L is not changed.
    """

    ahead = AHEAD

    _scale: float
    _pending: int  # columns of U and V in use, beside those of the precision
    _U: Tensor
    _V: Tensor
    _below: Tensor  # what W^T L owes to the blocks below the diagonal
    _largest: float  # no entry of L is larger
    _noted: set[int]  # members with columns other than zero
    _noise: Tensor  # the noise to come, (M, B, k, padded)
    _ahead: Tensor  # low z for it
    _stale: set[int]  # members for which ``_ahead`` has to be computed anew at each draw

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
        W = L.new_empty(self._count, self._d, 0) if W is None else W
        # the precision is scale * I minus the outer products of these
        self._columns = self._blocks(W.transpose(1, 2) * scale**0.5)
        self._rank = W.shape[2]
        self._among = _sums_after(self._columns @ self._columns.mT)
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
        draws, members, k, _ = noise.shape
        shape = members, draws, k, self._padded
        if self._noise.shape != shape:
            self._noise, self._ahead = noise.new_zeros(shape), noise.new_empty(shape)
        self._noise[..., : self._d] = noise.transpose(0, 1)
        factor = self._scale
        for m in range(members):
            # one after the other, so that a member's L is still in the cache when it is multiplied
            self._apply_to(m, factor)
            self._low_times(m, self._noise[m], self._ahead[m])
        self._settle()

    def product(self, at: int) -> Tensor:
        """L z (M, k, d) with the present L, for the draw ``at`` of the last ``look_ahead``."""
        z, ahead = self._noise[:, at], self._ahead[:, at]
        for m in self._stale:
            self._low_times(m, z[m], ahead[m])
        panels = self._blocks(z).flatten(0, 1)
        out = torch.empty_like(z)
        by_panel = out.unflatten(-1, (self._panels, self._width)).transpose(1, 2)
        own = torch.bmm(panels, self._diag.transpose(1, 2)).view(by_panel.shape)
        left = ahead.unflatten(-1, (self._panels, self._width)).transpose(1, 2)
        torch.add(own, left, alpha=self._scale, out=by_panel)
        if self._pending:
            by_panel.add_(self._put_off_times(panels), alpha=self._scale)
        return out[:, :, : self._d]

    def step(self, gradients: Tensor, noise: Tensor, kl_weight: float) -> None:
        """One SGD step; the TD part of the gradient is sum_k gradients_k noise_k^T, (M, n, d)."""
        over = self._rows_that_may_clip(gradients, noise, kl_weight)
        pull = self._alpha * kl_weight
        step = _Step(
            self._blocks(gradients).mul_(-self._alpha),
            self._blocks(noise),
            self._columns_times_L(),
            1 - pull * self._precision.scale,
            pull,
        )
        few, many = _few_and_many(over)
        changes = [self._clip_rows(m, over[m], step) for m in few]
        wholes = [self._take_out(m, step) for m in many]
        self._step_diagonal(step)
        self._put_off(step, many)
        for rows in changes:
            self._add_rows(rows)
        for whole in wholes:
            self._write_out(whole, step.shrink, pull)

    def _step_diagonal(self, step: _Step) -> None:
        left, right, pulled, shrink, pull = step
        diagonal = self._diag.diagonal(dim1=1, dim2=2)
        push = pull / diagonal
        self._diag.baddbmm_(left.flatten(0, 1).mT, right.flatten(0, 1), beta=shrink)
        if self._rank:
            self._diag.baddbmm_(self._columns.flatten(0, 1).mT, pulled.flatten(0, 1), alpha=pull)
        self._diag.tril_()
        diagonal.add_(push).clamp_(min=self._sigma_min)

    def _put_off(self, step: _Step, none: Sequence[int]) -> None:
        """Note the outer products of a step for the blocks below the diagonal.

        Those of some members are all zero.
        """
        left, right, pulled, shrink, pull = step
        added = left.shape[2]
        if not len(self._U):
            shape = self._count, self._panels, self._rank + AHEAD * added, self._width
            self._U, self._V = left.new_zeros(shape), left.new_zeros(shape)
            self._U[:, :, : self._rank] = self._columns
        start = self._rank + self._pending
        if self._scale * shrink < LEAST_SCALE or start + added > self._U.shape[2]:
            self._apply(shrink)
            start = self._rank
        else:
            self._scale *= shrink
        torch.div(left, self._scale, out=self._U[:, :, start : start + added])
        self._V[:, :, start : start + added] = right
        if self._rank:
            later = _sums_after(self._columns @ left.mT)
            self._below.mul_(shrink).add_(later @ right).add_(self._among @ pulled, alpha=pull)
            self._V[:, :, : self._rank].add_(pulled, alpha=pull / self._scale)
        self._pending += added
        self._noted |= set(range(self._count)) - set(none)

    def _put_off_times(self, z: Tensor) -> Tensor:
        """What the noted outer products add to L z, in blocks (M, P, k, width)."""
        U, V = (x.flatten(0, 1)[:, : self._rank + self._pending] for x in (self._U, self._V))
        along = torch.bmm(z, V.transpose(1, 2)).unflatten(0, (self._count, self._panels))
        before = along.cumsum(1).sub_(along)
        added: Tensor = torch.bmm(before.flatten(0, 1), U).unflatten(0, before.shape[:2])
        return added

    def _apply(self, shrink: float = 1.0) -> None:
        """Bring the blocks below the diagonal up to date, times a factor."""
        for m in range(self._count):
            self._apply_to(m, self._scale * shrink)
        self._settle()
        self._stale = set(range(self._count))

    def _apply_to(self, m: int, factor: float) -> None:
        low = self._low[m]
        if not self._pending:
            if factor != 1.0:
                low.mul_(factor)
            return
        U, right = self._put_off_of(m)
        for panel in range(1, self._panels):
            edge = panel * self._width
            rows = low[edge : edge + self._width, :edge]
            rows.addmm_(U[panel].T, right[:, :edge], beta=factor, alpha=factor)

    def _put_off_of(self, m: int) -> tuple[Tensor, Tensor]:
        """The columns of U (P, n, width) and, as rows, those of V (n, padded) of one member."""
        U, V = (x[m, :, : self._rank + self._pending] for x in (self._U, self._V))
        return U, V.transpose(0, 1).flatten(1)

    def _settle(self) -> None:
        """Nothing is put off, and what was looked ahead for is known."""
        if len(self._V):
            self._V[:, :, : self._rank] = 0.0
        self._scale, self._pending = 1.0, 0
        self._noted, self._stale = set(), set()

    def _low_times(self, m: int, noise: Tensor, out: Tensor) -> None:
        """Write low z of a member into out, for noise of its shape (..., padded)."""
        low, noise, out = self._low[m], noise.flatten(0, -2), out.view(-1, self._padded)
        for start in range(0, self._padded, STRIP * self._width):
            end = min(start + STRIP * self._width, self._padded)
            torch.mm(noise[:, :end], low[start:end, :end].T, out=out[:, start:end])

    def _columns_times_L(self) -> Tensor:
        """W^T L times the root of the precision's scale, in blocks (M, P, r, width)."""
        if not self._rank:
            return self._columns
        current = torch.bmm(self._columns.flatten(0, 1), self._diag)
        product: Tensor = current.view(self._columns.shape)
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
            self._largest = self._largest_entry()
        kl = kl_weight / self._sigma_min + pull * self._largest
        # an upper bound on the entries from here on, without reading L
        self._largest += self._alpha * min(td + kl, self._clip)
        if td + kl <= self._clip:
            return torch.zeros(sizes.shape[0], 1, dtype=torch.bool)
        return ~((sizes * reach.unsqueeze(-1)).sum(1) + kl <= self._clip)

    def _clip_rows(self, m: int, over: Tensor, step: _Step) -> _Rows:
        """Take rows of a member out of the step's outer products; what to add to them instead."""
        row = over.nonzero().flatten()
        panel, at = row // self._width, row % self._width
        L = self._rows_of_L(m, panel, at)
        change = step.left[m][panel, :, at] @ step.right[m]
        step.left[m, panel, :, at] = 0.0
        pulled = (self._columns[m][panel, :, at] @ step.pulled[m]) * step.pull
        change.add_(pulled).add_(L, alpha=step.shrink - 1)
        own = panel, torch.arange(len(row), device=row.device), at
        change[own] += step.pull / L[own]
        change.clamp_(-self._most, self._most)
        diagonal = (L[own] + change[own]).clamp_(min=self._sigma_min)
        columns = torch.arange(self._padded, device=row.device).view(L.shape[0], 1, -1)
        # what the step does to these rows all the same is taken off
        change.sub_(pulled).add_(L, alpha=1 - step.shrink).mul_(columns < row.unsqueeze(-1))
        return _Rows(m, panel, at, change, diagonal)

    def _rows_of_L(self, m: int, panel: Tensor, at: Tensor) -> Tensor:
        """Rows of one member's L, in blocks (P, rows, width)."""
        low = self._low[m, panel * self._width + at]
        rows: Tensor = low.unflatten(-1, (self._panels, self._width)).transpose(0, 1)
        if self._pending:
            U, V = (x[m, :, : self._rank + self._pending] for x in (self._U, self._V))
            rows = rows + U[panel, :, at] @ V
        below = torch.arange(self._panels, device=at.device).unsqueeze(-1) < panel
        rows = (rows * self._scale).mul_(below.unsqueeze(-1))
        blocks = self._diag.unflatten(0, (self._count, self._panels))
        rows[panel, torch.arange(len(at), device=at.device)] = blocks[m, panel, at]
        return rows

    def _add_rows(self, rows: _Rows) -> None:
        """Add to rows of one member's L below the diagonal, and set their diagonal entries."""
        m, panel, at, change, diagonal = rows
        blocks = self._diag.unflatten(0, (self._count, self._panels))
        blocks[m, panel, at] += change[panel, torch.arange(len(at), device=at.device)]
        blocks[m, panel, at, at] = diagonal
        below = torch.arange(self._panels, device=at.device).unsqueeze(-1) < panel
        change = change * below.unsqueeze(-1)
        self._below[m] += self._columns[m][panel, :, at].T @ change
        whole, row = change.transpose(0, 1).flatten(1) / self._scale, panel * self._width + at
        self._low[m, row] += whole
        if len(self._noise):
            self._ahead[m, :, :, row] += self._noise[m] @ whole.T

    def _take_out(self, m: int, step: _Step) -> _Whole:
        """Take a member out of the step's outer products, and bring its L up to date."""
        if m in self._noted:
            U, right = self._put_off_of(m)
            for panel in range(1, self._panels):
                edge = panel * self._width
                self._low[m, edge : edge + self._width, :edge].addmm_(U[panel].T, right[:, :edge])
            self._U[m, :, self._rank :] = 0.0
            self._V[m, :, : self._rank] = 0.0
            self._noted.discard(m)
        blocks = self._diag.unflatten(0, (self._count, self._panels))
        left = torch.cat([step.left[m], self._columns[m] * step.pull], 1)
        right = torch.cat([step.right[m], step.pulled[m]], 1).transpose(0, 1).flatten(1)
        step.left[m] = 0.0
        step.pulled[m] = 0.0
        return _Whole(m, left, right, blocks[m].clone())

    def _write_out(self, whole: _Whole, shrink: float, pull: float) -> None:
        """The step of one member with its gradient written out, a panel at a time."""
        m, left, right, diagonal_blocks = whole
        felt = 1 - shrink > ROUNDING
        bound, above = min(self._most / self._scale, LARGEST), left.mT / self._scale
        owed = right.new_zeros(self._rank, self._padded)
        steps = right.new_empty(self._width, self._padded)
        for panel in range(1, self._panels):
            edge = panel * self._width
            low = self._low[m, edge : edge + self._width, :edge]  # by now shrunk
            step = torch.mm(above[panel], right[:, :edge], out=steps[:, :edge])
            if felt:
                step.add_(low, alpha=(shrink - 1) / shrink)
                low.mul_(1 / shrink)
            low.add_(step.clamp_(-bound, bound))
            owed[:, :edge].addmm_(self._columns[m, panel], low, alpha=self._scale)
        self._below[m] = self._blocks(owed)
        step = left.mT @ self._blocks(right) + (shrink - 1) * diagonal_blocks
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
        self._diag = L.new_empty(self._count * self._panels, self._width, self._width)
        self._diag.view(-1, *blocks.shape[-1:], *self._diag.shape[1:]).copy_(
            blocks.permute(0, 3, 1, 2)
        )
        self._diag.diagonal(dim1=1, dim2=2).clamp_(min=self._sigma_min)
        blocks.zero_()
        self._low = low
        self._noise = self._ahead = L.new_empty(0)  # made when there is noise to look ahead to
        self._U = self._V = L.new_empty(0)  # made when the first outer product is put off
        self._settle()
        self._below = self._blocks(self._columns.transpose(1, 2).flatten(2) @ low)
        self._largest = self._largest_entry()

    def _largest_entry(self) -> float:
        self._apply()
        # no absolute values: they would be a copy of all factors
        extremes = [x for part in (self._low, self._diag) for x in torch.aminmax(part)]
        return float(torch.stack(extremes).abs().max())

    def _diagonal_blocks(self, matrix: Tensor) -> Tensor:
        """View (M, width, width, P) of the diagonal blocks of (M, padded, padded)."""
        shape = self._count, self._panels, self._width, self._panels, self._width
        return matrix.view(shape).diagonal(dim1=1, dim2=3)

    def _blocks(self, rows: Tensor) -> Tensor:
        """Vectors (..., k, up to padded) as blocks (..., P, k, width), padded with zeros."""
        *members, count, length = rows.shape
        blocks = rows.new_zeros(*members, self._panels, count, self._width)
        full, rest = divmod(length, self._width)
        whole = rows[..., : length - rest].unflatten(-1, (full, self._width))
        blocks[..., :full, :, :] = whole.transpose(-2, -3)
        if rest:
            blocks[..., full, :, :rest] = rows[..., length - rest :]
        return blocks


def _sums_after(blocks: Tensor) -> Tensor:
    """For each panel (axis 1) the sum over all later ones."""
    return blocks.sum(1, keepdim=True) - blocks.cumsum(1)


def _few_and_many(over: Tensor) -> tuple[list[int], list[int]]:
    """The members with some marked rows in (M, d), and those with many."""
    shares = over.float().mean(1).tolist()
    few = [m for m, share in enumerate(shares) if 0 < share <= MANY]
    return few, [m for m, share in enumerate(shares) if share > MANY]
