// The lower-triangular factor L of a Gaussian over d weights, in blocks of rows that are as wide as
// the triangle needs. A row is read once in an iteration: stepped, then multiplied with the noise to
// come, so that memory is passed once where separate operations would pass it several times.
#pragma once
#include "lanes.h"

constexpr int ROWS = 8;  // of a block

constexpr int columns_of(int block) { return padded(ROWS * (block + 1)); }
static inline float bounded(float x, float most) { return x > most ? most : x < -most ? -most : x; }

// What a step needs to know: the prior's precision is scale * (I - W W^T), with `sources` columns W;
// with `diagonal` the divergence is felt by diag(L) alone. clip bounds the gradient's entries, kl_clip
// before it is weighted those of the divergence's.
struct Descent {
  int32_t d, n_samples, sources, diagonal;
  float alpha, sigma_min, clip, kl_clip, scale;
};

constexpr int64_t factor_size(int d) {
  int64_t size = 0;
  for (int block = 0; block * ROWS < d; block++) size += ROWS * columns_of(block);
  return size;
}

// Copies rows (d, d) into blocks, whose size is zero elsewhere; or blocks into rows.
template <bool INTO> void copy_factor(int d, float *rows, float *L) {
  for (int row = 0; row < d; row++) {
    int width = columns_of(row / ROWS);
    float *inside = L + row % ROWS * width, *outside = rows + (int64_t)row * d;
    for (int i = 0; i <= row; i++) {
      if (INTO) inside[i] = outside[i];
      else outside[i] = inside[i];
    }
    if (row % ROWS == ROWS - 1) L += ROWS * width;
  }
}

// One step on L (eqs. 5.9 and 5.11, clipped), and out = L times the noise to come. With no step only
// the product. gradient (d, LANES), its samples from the second on; z (n + 1, wide), those samples'
// noise; upcoming and out (d, LANES); W and WL = W^T L (sources, wide), next likewise to work in.
static void step_and_multiply(const Descent f, float *L, const float *W, float *WL, float *next,
                              const float (*gradient)[LANES], const float *z,
                              const float (*upcoming)[LANES], float (*out)[LANES], float pull,
                              bool step) {
  const int wide = padded(f.d), sources = f.diagonal ? 0 : f.sources;
  const Lanes clip = all(f.clip), kl_clip = all(f.kl_clip);
  for (int i = 0; i < sources * wide; i += LANES) at(next + i) = Lanes{};
  for (int first = 0, block = 0; first < f.d; first += ROWS, block++) {
    int width = columns_of(block), rows = f.d - first < ROWS ? f.d - first : ROWS;
    float diagonal[ROWS];
    for (int r = 0; r < rows; r++) diagonal[r] = L[r * width + first + r];
    for (int col = 0; col < width && step; col += LANES) {
      Lanes slope[ROWS] = {}, kl[ROWS];
      for (int k = 1; k <= f.n_samples; k++) {
        Lanes noise = at(z + k * wide + col);
        for (int r = 0; r < ROWS; r++) slope[r] += gradient[first + r][k] * noise;
      }
      for (int r = 0; r < ROWS; r++) kl[r] = at(L + r * width + col);
      for (int j = 0; j < sources; j++) {
        Lanes along = at(WL + j * wide + col);
        for (int r = 0; r < ROWS; r++) kl[r] -= W[j * wide + first + r] * along;
      }
      float weight = f.diagonal ? 0 : pull;
      for (int r = 0; r < ROWS; r++) {
        slope[r] += weight * bounded(f.scale * kl[r], kl_clip);
        at(L + r * width + col) -= f.alpha * bounded(slope[r], clip);
      }
    }
    for (int r = 0; r < rows && step; r++) {
      // the diagonal, which the divergence also pushes by -1 / L_ii, and nothing right of it
      int row = first + r;
      float slope = 0, kl = diagonal[r];
      for (int k = 1; k <= f.n_samples; k++) slope += gradient[row][k] * z[k * wide + row];
      for (int j = 0; j < f.sources; j++)
        kl -= W[j * wide + row] * (f.diagonal ? W[j * wide + row] * diagonal[r] : WL[j * wide + row]);
      slope += pull * bounded(kl * f.scale - 1 / diagonal[r], f.kl_clip);
      float own = diagonal[r] - f.alpha * bounded(slope, f.clip);
      L[r * width + row] = own < f.sigma_min ? f.sigma_min : own;
      for (int i = row + 1; i < width; i++) L[r * width + i] = 0;
    }
    for (int i = rows * width; i < ROWS * width; i++) L[i] = 0;
    Lanes product[ROWS] = {};
    for (int i = 0; i < width; i++) {
      Lanes noise = at(upcoming[i]);
      for (int r = 0; r < ROWS; r++) product[r] += L[r * width + i] * noise;
    }
    for (int r = 0; r < rows; r++) at(out[first + r]) = product[r];
    for (int col = 0; col < width && sources; col += LANES)
      for (int j = 0; j < sources; j++) {
        Lanes along = at(next + j * wide + col);
        for (int r = 0; r < ROWS; r++)
          along += W[j * wide + first + r] * at(L + r * width + col);
        at(next + j * wide + col) = along;
      }
    L += ROWS * width;
  }
  for (int i = 0; i < sources * wide; i += LANES) at(WL + i) = at(next + i);
}
