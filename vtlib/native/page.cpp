// The kernel of the rooms for a page: one run in the module's own memory, and random numbers of a
// small generator whose seed the page shows.
#include "rooms.cpp"

namespace {

constexpr int MOST_BUFFER = 50000, AHEAD = 1;
alignas(64) unsigned char memory[sizeof(Run) + MOST_BUFFER * sizeof(Transition)];
alignas(64) float factors[1][1];
alignas(64) float noise[MOST_COMPONENTS * LANES * D + LANES];
float uniforms[256 + 16];
Run &run = *(Run *)memory;

// xoshiro128++, sixteen generators side by side. Source: Blackman and Vigna (2021).
typedef uint32_t Words __attribute__((vector_size(64)));
Words state[4];

Words rotated(Words x, int k) { return (x << k) | (x >> (32 - k)); }
Words next_words() {
  Words result = rotated(state[0] + state[3], 7) + state[0], t = state[1] << 9;
  state[2] ^= state[0], state[3] ^= state[1], state[1] ^= state[2], state[0] ^= state[3];
  state[2] ^= t, state[3] = rotated(state[3], 11);
  return result;
}
Lanes uniform() { return __builtin_convertvector((Bits)(next_words() >> 8), Lanes) * 0x1p-24f; }

// cos(2 pi u) and sin(2 pi u) of u in [0, 1), by polynomials on a quarter of the circle.
void circle(Lanes u, Lanes *cosine, Lanes *sine) {
  Lanes q = u * 4.0f + 0.5f;
  Bits quarter = __builtin_convertvector(q, Bits);
  Lanes x = (u * 4.0f - __builtin_convertvector(quarter, Lanes)) * 1.57079633f, y = x * x;
  Lanes s = x + x * y * (-1.6666654611e-1f + y * (8.3321608736e-3f + y * -1.9515295891e-4f));
  Lanes c = 1.0f - y * 0.5f +
            y * y * (4.166664568298827e-2f + y * (-1.388731625493765e-3f + y * 2.443315711809948e-5f));
  Bits odd = -(quarter & 1), turned = -((quarter + 1) >> 1 & 1), back = -(quarter >> 1 & 1);
  *cosine = select(turned, -select(odd, s, c), select(odd, s, c));
  *sine = select(back, -select(odd, c, s), select(odd, c, s));
}

// Standard normal numbers. Source: Box and Muller (1958).
void normal(float *out, int count) {
  for (int i = 0; i < count; i += 2 * LANES) {
    Lanes u = 1.0f - uniform(), square = logarithm(u) * -2.0f, radius, cosine, sine;
    for (int j = 0; j < LANES; j++) radius[j] = __builtin_sqrtf(square[j]);
    circle(uniform(), &cosine, &sine);
    *(Lanes *)(out + i) = radius * cosine;
    if (i + LANES < count) *(Lanes *)(out + i + LANES) = radius * sine;
  }
}
}  // namespace
