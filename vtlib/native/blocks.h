// The factor L of a Gaussian over many weights, which no cache holds: memory is passed once in a block
// of iterations. The noise z of a block is known when it begins, so all its products with L are made
// then; a step is put off as outer products u v^T, v its noise, which a sample that follows feels by
// the sums of v_j z_j over the columns j before. The squares on the diagonal are stepped at once.
#pragma once
#include "factor.h"

constexpr int VECTORS = 3, SIDE = VECTORS * LANES;  // L is stored by panels of rows, in squares
constexpr int DRAWS = 96;                           // noise vectors in a block, at most
constexpr int STRIDE = DRAWS + LANES;               // theirs, of each column of L
#ifdef __AVX512F__
constexpr int TILE = 8;  // columns at work, as many as registers hold
#else
constexpr int TILE = 2;
#endif
typedef Lanes Tile[TILE][VECTORS];

// L below the diagonal's squares is shrunk * (squares + left * noise^T of the first `pending` draws),
// and has no entry beyond `largest`; `ahead` is the squares' product with draws before `known`.
struct Member {
  int32_t pending, known, turn;
  float shrunk, largest, reach[DRAWS];  // the largest entry of each draw
};
static inline int panels_of(int d) { return (d + SIDE - 1) / SIDE; }

struct Blocks {
  int d, panels;
  Member *m;
  float *squares, *lefts, *aheads, *noises;
  Blocks(int d, float *memory) : d(d), panels(panels_of(d)), m((Member *)memory) {
    squares = memory + padded(sizeof(Member) / sizeof(float));
    lefts = squares + panels * (panels + 1) / 2 * SIDE * SIDE;
    aheads = lefts + panels * DRAWS * SIDE;
    noises = aheads + panels * STRIDE * SIDE;
  }
  float *square(int row, int col) const { return squares + (row * (row + 1) / 2 + col) * SIDE * SIDE; }
  float *left(int panel) const { return lefts + panel * DRAWS * SIDE; }
  float *ahead(int panel) const { return aheads + panel * STRIDE * SIDE; }
  float *noise(int turn, int panel) const { return noises + (turn * panels + panel) * SIDE * STRIDE; }
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

static inline void fetch(const float *from, int floats) {
  for (int i = 0; i < floats; i += LANES) __builtin_prefetch(from + i);
}

// Takes in what was put off, and multiplies with the draws first.. of a turn: L is passed once.
static void settle(const Blocks &b, int turn, int first, int count) {
  Member &m = *b.m;
  Lanes largest = {};
  for (int p = 0; p < b.panels; p++) {
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
  m.turn = turn, m.pending = 0, m.shrunk = 1, m.largest = top(largest), m.known = first + count;
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
    const float *v = b.noise(m.turn, p), *z = v + first;
    fetch(b.square(p + 1, p + 1), SIDE * SIDE), fetch(b.left(p + 1), m.pending * SIDE);
    fetch(b.ahead(p + 1) + first * SIDE, count * SIDE);
    for (int i = 0; i < SIDE; i++) fetch(v + (SIDE + i) * STRIDE, first + count);
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
}

// One step on a square as it stands (eqs. 5.9 and 5.11, clipped), from gradients and noise.
static void step_square(const Descent &f, float *square, const float *gradient, const float *v,
                        float pull) {
  for (int i = 0; i < SIDE; i += TILE) {
    Tile slope = {};
    add(slope, f.n_samples, gradient, SIDE, v + i * STRIDE, 1, STRIDE);
    for (int c = 0; c < TILE; c++)
      for (int r = 0; r < VECTORS; r++) {
        Lanes &own = at(square + (i + c) * SIDE + r * LANES);
        slope[c][r] += pull * bounded(f.scale * own, all(f.kl_clip));
        own -= f.alpha * bounded(slope[c][r], all(f.clip));
      }
  }
}

// The same on the diagonal, which the divergence also pushes by -1 / L_ii; nothing right of it.
static void step_diagonal(const Descent &f, float *square, const float *gradient, const float *v,
                          float pull, const float *precision, int side) {
  float own[SIDE], slope[SIDE];
  for (int i = 0; i < side; i++) {
    own[i] = square[i * SIDE + i];
    slope[i] = pull * bounded(precision[i] * own[i] - 1 / own[i], f.kl_clip);
  }
  for (int k = 0; k < f.n_samples; k++)
    for (int i = 0; i < side; i++) slope[i] += gradient[k * SIDE + i] * v[i * STRIDE + k];
  step_square(f, square, gradient, v, f.diagonal ? 0 : pull);
  for (int i = 0; i < side; i++) {
    own[i] -= f.alpha * bounded(slope[i], f.clip);
    square[i * SIDE + i] = own[i] < f.sigma_min ? f.sigma_min : own[i];
    for (int row = 0; row < i; row++) square[i * SIDE + row] = 0;
  }
}

// One step on L, with gradients (n_samples, d) at the draws first.. of which the last `n_samples` count;
// put off, if for sure no entry is clipped. precision (d): the prior's diagonal; work: as lefts.
static void step_block(const Descent &f, const Blocks &b, int first, int count, const float *gradients,
                       float pull, const float *precision, float *work) {
  Member &m = *b.m;
  int n = f.n_samples, from = first + count - n;
  float weight = f.diagonal ? 0 : pull * f.scale;
  Lanes largest = {};
  for (int p = 0; p < b.panels; p++) {
    float *rows = work + p * LANES * SIDE;
    Lanes total[VECTORS] = {};
    for (int k = 0; k < n; k++) {
      float *row = rows + k * SIDE;
      for (int i = b.height(p); i < SIDE; i++) row[i] = 0;
      __builtin_memcpy(row, gradients + (int64_t)k * b.d + p * SIDE, b.height(p) * sizeof(float));
      for (int r = 0; r < VECTORS; r++) total[r] += size(at(row + r * LANES)) * m.reach[from + k];
    }
    for (Lanes x : total) largest = larger(x, largest);
  }
  float steepest = top(largest) + weight * m.largest, shrink = 1 - f.alpha * weight;
  bool linear = steepest <= f.clip && shrink >= 0.5f && (f.diagonal || f.scale * m.largest <= f.kl_clip);
  if (!linear) settle(b, m.turn, 0, 0);
  m.largest += f.alpha * (steepest < f.clip ? steepest : f.clip);
  if (linear) m.shrunk *= shrink;
  if (linear) m.pending = first + count;
  float rate = -f.alpha / m.shrunk;
  for (int p = 0; p < b.panels; p++) {
    const float *gradient = work + p * LANES * SIDE, *v = b.noise(m.turn, p) + from;
    step_diagonal(f, b.square(p, p), gradient, v, pull, precision + p * SIDE, b.height(p));
    for (int q = 0; q < p && !linear; q++)
      step_square(f, b.square(p, q), gradient, b.noise(m.turn, q) + from, f.diagonal ? 0 : pull);
    for (int i = 0; i < n * SIDE && linear; i += LANES)
      at(b.left(p) + from * SIDE + i) += rate * at(gradient + i);
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
