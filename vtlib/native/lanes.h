// Sixteen floats side by side, and the few functions of them that the kernels need. The compiler
// makes of them what the processor has: one AVX-512 register, two of AVX2, four of WebAssembly's.
#pragma once
#include <stdint.h>

constexpr int LANES = 16;
constexpr int padded(int n) { return (n + LANES - 1) / LANES * LANES; }
typedef float Lanes __attribute__((vector_size(64)));
typedef int32_t Bits __attribute__((vector_size(64)));

static inline Lanes all(float x) { return Lanes{} + x; }
static inline Lanes &at(float *x) { return *(Lanes *)x; }
static inline const Lanes &at(const float *x) { return *(const Lanes *)x; }
static inline Lanes select(Bits mask, Lanes a, Lanes b) {
  return (Lanes)((mask & (Bits)a) | (~mask & (Bits)b));
}
static inline Lanes larger(Lanes a, Lanes b) { return a > b ? a : b; }
static inline Lanes bounded(Lanes x, Lanes most) {
  x = x > most ? most : x;
  return x < -most ? -most : x;
}
static inline float sum(Lanes x) {
  float total = 0;
  for (int i = 0; i < LANES; i++) total += x[i];
  return total;
}

// exp(x) for x in [-87, 0], to a few units in the last place: 2^k times a polynomial (Cephes).
static inline Lanes exponential(Lanes x) {
  Bits whole = __builtin_convertvector(x * 1.44269504f - 0.5f, Bits);
  Lanes k = __builtin_convertvector(whole, Lanes), r = x - k * 0.693359375f + k * 2.12194440e-4f;
  Lanes p = all(1.9875691500e-4f);
  const float more[] = {1.3981999507e-3f, 8.3334519073e-3f, 4.1665795894e-2f, 1.6666665459e-1f, 0.5f};
  for (float c : more) p = p * r + c;
  return (Lanes)((Bits)(p * r * r + r + 1.0f) + (whole << 23));
}

// log(x) for x in (0, 1], likewise.
static inline Lanes logarithm(Lanes x) {
  Bits exponent = ((Bits)x >> 23) - 126;
  Lanes m = (Lanes)(((Bits)x & 0x007fffff) | 0x3f000000);  // in [0.5, 1)
  Bits low = m < 0.70710678f;
  exponent += low;  // a mask is -1
  m = select(low, m + m, m) - 1.0f;
  Lanes p = all(7.0376836292e-2f), e = __builtin_convertvector(exponent, Lanes);
  const float more[] = {-1.1514610310e-1f, 1.1676998740e-1f,  -1.2420140846e-1f, 1.4249322787e-1f,
                        -1.6668057665e-1f, 2.0000714765e-1f, -2.4999993993e-1f, 3.3333331174e-1f};
  for (float c : more) p = p * m + c;
  return m * m * m * p - m * m * 0.5f + m - e * 2.12194440e-4f + e * 0.693359375f;
}

// The same of single doubles, in series: responsibilities are few, and need the digits.
static double exp_of(double x) {
  if (x != x || x < -700) return x < 0 ? 0 : x;
  int k = (int)(x * 1.4426950408889634 - 0.5);
  double r = x - k * 0.6931471805599453, term = 1, total = 1;
  for (int i = 1; i < 16; i++) total += term *= r / i;
  union { int64_t bits; double number; } power = {(int64_t)(1023 + k) << 52};
  return total * power.number;
}
static double log_of(double x) {
  double whole = 0;
  for (; x > 1.5; x /= 2) whole += 0.6931471805599453;
  double r = (x - 1) / (x + 1), term = r, total = 0;
  for (int i = 1; i < 40; i += 2, term *= r * r) total += term / i;
  return whole + 2 * total;
}
static double log_of_sum(const double *x, int count, int stride) {
  double top = x[0], total = 0;
  for (int i = 1; i < count; i++) top = x[i * stride] > top ? x[i * stride] : top;
  for (int i = 0; i < count; i++) total += exp_of(x[i * stride] - top);
  return top + log_of(total);
}
static double power_of(double x, int64_t n) {
  double power = 1;
  for (; n; n >>= 1, x *= x)
    if (n & 1) power *= x;
  return power;
}
