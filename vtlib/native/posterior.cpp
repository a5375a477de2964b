// What Python calls: the posterior's step for any Q-function.
#include <stdlib.h>

#include "blocks.h"

extern "C" int64_t posterior_size(int32_t d) { return factor_size(d); }
extern "C" void posterior_pack(int32_t d, float *rows, float *L) { copy_factor<true>(d, rows, L); }
extern "C" void posterior_unpack(int32_t d, float *rows, float *L) { copy_factor<false>(d, rows, L); }

static void *room(int64_t floats) { return aligned_alloc(64, (floats * 4 + 63) / 64 * 64); }

// Steps the factors of `members` Gaussians (if `step`) and multiplies them with noise to come.
// gradients, z (members, n_samples, d); noise, out (members, count, d); W, WL (members, sources, wide).
extern "C" void posterior_step(const Descent *f, int32_t members, int32_t count, float *L,
                               const float *W, float *WL, const float *gradients, const float *z,
                               const float *noise, float *out, float pull, int32_t step) {
  int d = f->d, n = f->n_samples, wide = padded(d);
  int64_t size = factor_size(d), block = (int64_t)wide * LANES;
  float *next = (float *)room((int64_t)(f->sources + 1) * wide);
  float(*gradient)[LANES] = (float(*)[LANES])room(block), (*upcoming)[LANES], (*product)[LANES];
  upcoming = (float(*)[LANES])room(block), product = (float(*)[LANES])room(block);
  float *padded_z = (float *)room((int64_t)(n + 1) * wide);
  for (int i = 0; i < wide; i++) at(gradient[i]) = at(upcoming[i]) = Lanes{};
  for (int64_t i = 0; i < (int64_t)(n + 1) * wide; i++) padded_z[i] = 0;
  for (int m = 0; m < members; m++) {
    for (int i = 0; i < d; i++) {
      for (int k = 0; k < count; k++) upcoming[i][k] = noise[((int64_t)m * count + k) * d + i];
      for (int k = 0; k < n && step; k++) {
        gradient[i][k + 1] = gradients[((int64_t)m * n + k) * d + i];
        padded_z[(k + 1) * wide + i] = z[((int64_t)m * n + k) * d + i];
      }
    }
    int64_t columns = (int64_t)m * f->sources * wide;
    step_and_multiply(*f, L + m * size, W + columns, WL + columns, next, gradient, padded_z, upcoming,
                      product, pull, step);
    for (int i = 0; i < d; i++)
      for (int k = 0; k < count; k++) out[((int64_t)m * count + k) * d + i] = product[i][k];
  }
  free(next), free(gradient), free(upcoming), free(product), free(padded_z);
}

// The same in blocks of iterations, of which the next is number t. members, memory: so many `Blocks`.
// noise (groups, members, count, d); out (members, count, d); gradients (members, n_samples, d).
extern "C" int64_t blocks_size(int32_t d) { return Blocks(d, nullptr).end() - (float *)nullptr; }
extern "C" void blocks_pack(int32_t d, float *rows, float *memory) { copy_blocks<true>({d, memory}, rows); }
extern "C" void blocks_unpack(int32_t d, float *rows, float *memory) {
  settle({d, memory}, ((Member *)memory)->turn, 0, 0);
  copy_blocks<false>({d, memory}, rows);
}
extern "C" void blocks_begin(int32_t d, int32_t members, int32_t groups, int32_t count, float *memory,
                             const float *noise) {
  int64_t size = blocks_size(d), draws = (int64_t)count * d;
  for (int m = 0; m < members; m++)
    begin_block({d, memory + m * size}, noise + m * draws, groups, count, members * draws);
}
extern "C" void blocks_product(int32_t d, int32_t members, int32_t t, int32_t count, float *memory,
                               float *out) {
  int64_t size = blocks_size(d), draws = (int64_t)count * d;
  for (int m = 0; m < members; m++)
    product({d, memory + m * size}, t * count, count, out + m * draws);
}
// precision (members, d), the diagonal of the prior's, must outlive the next call.
extern "C" void blocks_step(const Descent *f, int32_t members, int32_t t, int32_t count, float *memory,
                            const float *precision, const float *gradients, float pull) {
  int64_t size = blocks_size(f->d), draws = (int64_t)f->n_samples * f->d;
  for (int m = 0; m < members; m++)
    step_block(*f, {f->d, memory + m * size}, t * count, count, gradients + m * draws,
               precision + (int64_t)m * f->d, pull);
}
