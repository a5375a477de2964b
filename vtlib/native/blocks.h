// The factor L of a Gaussian over many weights, which no cache holds: memory is passed once in a block
// of iterations. The noise z of a block is known when it begins, so all its products with L are made
// then; a step is put off as outer products u v^T, v its noise, which a sample that follows feels by
// the sums of v_j z_j over the columns j before. Only the squares on the diagonal are never put off.
#pragma once
#include "factor.h"

constexpr int VECTORS = 2, SIDE = VECTORS * LANES;  // L is stored by panels of rows, in squares
constexpr int DRAWS = 96;                           // noise vectors in a block, at most
constexpr int STRIDE = DRAWS + LANES;               // theirs, of each column of L
#ifdef __AVX512F__
constexpr int TILE = 8;  // columns at work, as many as registers hold
#else
constexpr int TILE = 2;
#endif
typedef Lanes Tile[TILE][VECTORS];

// L below the diagonal's squares is shrunk * (squares + left * noise^T of the first `pending` draws),
// and has no entry beyond `largest`; `ahead` is the squares' product with draws before `known`. While
// one `waits`, the diagonal's squares are yet to be stepped: with the draws from `from` on, as `step`
// says, pulled by the diagonal (d) of the prior's precision.
struct Member {
  Descent step;
  const float *precision;
  int32_t pending, known, turn, from, waits;
  float shrunk, largest, pull, reach[DRAWS];  // the largest entry of each draw
};
static inline int64_t panels_of(int d) { return (d + SIDE - 1) / SIDE; }

struct Blocks {
  int d;
  int64_t panels;  // places in memory need more than 31 bits from 65,500 weights on
  Member *m;
  float *squares, *lefts, *aheads, *noises;
  Blocks(int d, float *memory) : d(d), panels(panels_of(d)), m((Member *)memory) {
    squares = memory + padded(sizeof(Member) / sizeof(float));
    lefts = squares + panels * (panels + 1) / 2 * SIDE * SIDE;
    aheads = lefts + panels * DRAWS * SIDE;
    noises = aheads + panels * STRIDE * SIDE;
  }
  float *square(int64_t row, int col) const { return squares + (row * (row + 1) / 2 + col) * SIDE * SIDE; }
  float *left(int64_t panel) const { return lefts + panel * DRAWS * SIDE; }
  float *ahead(int64_t panel) const { return aheads + panel * STRIDE * SIDE; }
  float *noise(int turn, int64_t panel) const { return noises + (turn * panels + panel) * SIDE * STRIDE; }
  int height(int panel) const { return d - panel * SIDE < SIDE ? d - panel * SIDE : SIDE; }
  float *end() const { return noise(2, 0); }
};

// tile[c] += sum over k < n of a[k][0..SIDE) * b[k, c], whose strides are given.
static inline void add(Tile &tile, int n, const float *a, int a_k, const float *b, int b_k, int b_c) {
  for (int k = 0; k < n; k++, a += a_k, b += b_k) {
    Lanes row[VECTORS];
    for (int r = 0; r < VECTORS; r++) row[r] = at(a + r * LANES);
    for (int c = 0; c < TILE; c++) {
      float times = b[c * b_c];
      for (int r = 0; r < VECTORS; r++) tile[c][r] += times * row[r];
    }
  }
}
static inline void load(Tile &tile, const float *from, int stride) {
  for (int c = 0; c < TILE; c++)
    for (int r = 0; r < VECTORS; r++) tile[c][r] = at(from + c * stride + r * LANES);
}
static inline void store(const Tile &tile, float *to, int stride) {
  for (int c = 0; c < TILE; c++)
    for (int r = 0; r < VECTORS; r++) at(to + c * stride + r * LANES) = tile[c][r];
}
static inline void scale(Tile &tile, float by) {
  for (int c = 0; c < TILE; c++)
    for (int r = 0; r < VECTORS; r++) tile[c][r] *= by;
}
static inline float top(Lanes x) {
  float most = 0;
  for (int i = 0; i < LANES; i++) most = x[i] > most ? x[i] : most;
  return most;
}
static inline Lanes size(Lanes x) { return larger(x, -x); }

// The step on a square of L as it is (eqs. 5.9 and 5.11, clipped), with gradients by way of `left`.
static void step_square(const Blocks &b, int p, int q, float pull) {
  const Descent f = b.m->step;
  const float *v = b.noise(b.m->turn, q) + b.m->from, *left = b.left(p) + b.m->from * SIDE;
  const float back = -b.m->shrunk / f.alpha;
  for (int i = 0; i < SIDE; i += TILE) {
    Tile slope = {}, own;
    add(slope, f.n_samples, left, SIDE, v + i * STRIDE, 1, STRIDE);
    load(own, b.square(p, q) + i * SIDE, SIDE);
    for (int c = 0; c < TILE; c++)
      for (int r = 0; r < VECTORS; r++) {
        slope[c][r] = slope[c][r] * back + pull * bounded(f.scale * own[c][r], all(f.kl_clip));
        own[c][r] -= f.alpha * bounded(slope[c][r], all(f.clip));
      }
    store(own, b.square(p, q) + i * SIDE, SIDE);
  }
}

// The same on the diagonal, which the divergence also pushes by -1 / L_ii; nothing right of it.
static void step_diagonal(const Blocks &b, int p) {
  const Descent f = b.m->step;
  const float *v = b.noise(b.m->turn, p) + b.m->from, *left = b.left(p) + b.m->from * SIDE;
  const float back = -b.m->shrunk / f.alpha, pull = b.m->pull;
  float *square = b.square(p, p), own[SIDE], slope[SIDE] = {};
  for (int i = 0; i < SIDE; i++) own[i] = square[i * SIDE + i];
  for (int k = 0; k < f.n_samples; k++)
    for (int i = 0; i < SIDE; i++) slope[i] += left[k * SIDE + i] * v[i * STRIDE + k];
  step_square(b, p, p, f.diagonal ? 0 : pull);
  for (int i = 0; i < b.height(p); i++) {
    float kl = b.m->precision[p * SIDE + i] * own[i] - 1 / own[i];
    own[i] -= f.alpha * bounded(slope[i] * back + pull * bounded(kl, f.kl_clip), f.clip);
    square[i * SIDE + i] = own[i] < f.sigma_min ? f.sigma_min : own[i];
    for (int row = 0; row < i; row++) square[i * SIDE + row] = 0;
  }
}

// Takes in what was put off, and multiplies with the draws first.. of a turn: L is passed once.
static void settle(const Blocks &b, int turn, int first, int count) {
  Member &m = *b.m;
  Lanes largest = {};
  for (int p = 0; p < b.panels; p++) {
    if (m.waits) step_diagonal(b, p);
    for (int i = 0; i < (count + TILE - 1) / TILE * TILE * SIDE; i++) b.ahead(p)[first * SIDE + i] = 0;
    for (int q = 0; q < p; q++) {
      float *square = b.square(p, q), *v = b.noise(m.turn, q), *z = b.noise(turn, q) + first;
      for (int i = 0; i < SIDE; i += TILE) {
        Tile tile;
        load(tile, square + i * SIDE, SIDE);
        add(tile, m.pending, b.left(p), SIDE, v + i * STRIDE, 1, STRIDE);
        scale(tile, m.shrunk);
        store(tile, square + i * SIDE, SIDE);
        for (int j = i * SIDE; j < (i + TILE) * SIDE; j += LANES)
          largest = larger(size(at(square + j)), largest);
      }
      for (int k = 0; k < count; k += TILE) {
        float *ahead = b.ahead(p) + (first + k) * SIDE;
        Tile tile;
        load(tile, ahead, SIDE);
        add(tile, SIDE, square, SIDE, z + k, STRIDE, 1);
        store(tile, ahead, SIDE);
      }
    }
    for (int i = 0; i < m.pending * SIDE; i++) b.left(p)[i] = 0;
  }
  m.turn = turn, m.pending = m.waits = 0, m.shrunk = 1, m.largest = top(largest);
  m.known = first + count;
}

// Begins a block with its noise, `groups` times `count` draws (d); from a group to the next it is `apart`.
static void begin_block(const Blocks &b, const float *noise, int groups, int count, int64_t apart) {
  int turn = 1 - b.m->turn;
  for (int k = 0; k < groups * count; k++) b.m->reach[k] = 0;
  for (int p = 0; p < b.panels; p++)
    for (int k = 0; k < groups * count; k++) {
      const float *draw = noise + k / count * apart + (int64_t)(k % count) * b.d + p * SIDE;
      float *z = b.noise(turn, p) + k, reach = b.m->reach[k];
      for (int i = 0; i < b.height(p); i++) {
        z[i * STRIDE] = draw[i];
        reach = __builtin_fabsf(draw[i]) > reach ? __builtin_fabsf(draw[i]) : reach;
      }
      b.m->reach[k] = reach;
    }
  settle(b, turn, 0, groups * count);
}

// out (count, d) = L times the draws first..
static void product(const Blocks &b, int first, int count, float *out) {
  Member &m = *b.m;
  if (m.known < first + count) settle(b, m.turn, first, count);
  alignas(64) float sums[LANES][STRIDE] = {}, rows[LANES][SIDE];  // sums of v_j z_j, up to the panel
  for (int p = 0; p < b.panels; p++) {
    if (m.waits) step_diagonal(b, p);
    const float *v = b.noise(m.turn, p), *z = v + first;
    for (int k = 0; k < count; k += TILE) {
      Tile tile;
      load(tile, b.ahead(p) + (first + k) * SIDE, SIDE);
      add(tile, m.pending, b.left(p), SIDE, sums[k], 1, STRIDE);
      scale(tile, m.shrunk);
      add(tile, SIDE, b.square(p, p), SIDE, z + k, STRIDE, 1);
      store(tile, rows[k], SIDE);
      for (int j = 0; j < m.pending; j += SIDE) {
        Tile tile;
        load(tile, sums[k] + j, STRIDE);
        add(tile, SIDE, v + j, STRIDE, z + k, STRIDE, 1);
        store(tile, sums[k] + j, STRIDE);
      }
    }
    for (int k = 0; k < count; k++)
      for (int i = 0; i < b.height(p); i++) out[(int64_t)k * b.d + p * SIDE + i] = rows[k][i];
  }
  m.waits = 0;
}

// No entry of the TD error's gradient, at draws from `from` on, is larger.
static float steepest(const Blocks &b, const Descent &f, int from, const float *gradients) {
  float most = 0;
  for (int p = 0; p < b.panels; p++) {
    float total[SIDE] = {};
    for (int k = 0; k < f.n_samples; k++)
      for (int i = 0; i < b.height(p); i++)
        total[i] += __builtin_fabsf(gradients[(int64_t)k * b.d + p * SIDE + i]) * b.m->reach[from + k];
    for (float x : total) most = x > most ? x : most;
  }
  return most;
}

// One step on L, with gradients (n_samples, d) at the last of the draws first..; below the diagonal's
// squares it is put off, if for sure no entry is clipped.
static void step_block(const Descent &f, const Blocks &b, int first, int count, const float *gradients,
                       const float *precision, float pull) {
  Member &m = *b.m;
  if (m.pending > first) settle(b, m.turn, 0, 0);  // a second step at the same draws
  int from = first + count - f.n_samples;
  float weight = f.diagonal ? 0 : pull * f.scale, shrink = 1 - f.alpha * weight;
  float most = steepest(b, f, from, gradients) + weight * m.largest;
  bool linear = most <= f.clip && shrink >= 0.5f && (f.diagonal || f.scale * m.largest <= f.kl_clip);
  if (!linear) settle(b, m.turn, 0, 0);
  m.step = f, m.precision = precision, m.pull = pull, m.from = from;
  m.largest += f.alpha * (most < f.clip ? most : f.clip);
  if (linear) m.shrunk *= shrink, m.pending = first + count, m.waits = 1;
  for (int p = 0; p < b.panels; p++) {
    float *left = b.left(p) + from * SIDE;
    for (int k = 0; k < f.n_samples; k++)
      for (int i = 0; i < b.height(p); i++)
        left[k * SIDE + i] = -f.alpha / m.shrunk * gradients[(int64_t)k * b.d + p * SIDE + i];
    for (int q = 0; q < p && !linear; q++) step_square(b, p, q, f.diagonal ? 0 : pull);
    if (!linear) step_diagonal(b, p);
    for (int i = 0; i < f.n_samples * SIDE && !linear; i++) left[i] = 0;
  }
}

// Takes over rows (d, d), or gives them out: L as it is when nothing is put off.
template <bool INTO> void copy_blocks(const Blocks &b, float *rows) {
  for (int row = 0; row < b.d; row++)
    for (int i = 0; i <= row; i++) {
      float &inside = b.square(row / SIDE, i / SIDE)[i % SIDE * SIDE + row % SIDE];
      float &outside = rows[(int64_t)row * b.d + i];
      if (INTO) inside = outside;
      else outside = inside;
    }
  if (INTO) b.m->shrunk = 1;
}
