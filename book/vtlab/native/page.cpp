// A run of a task inside a reader's page: in the module's own memory, with random numbers from a small
// generator of its own, which gives the same for a seed on every machine. Each task (-DTASK=) has a module.
#include "networks.h"
#include "rooms.h"

typedef TASK Task;
constexpr int D = Task::D, MOST_BUFFER = 50000, BATCH = 512;
typedef uint32_t Words __attribute__((vector_size(64)));

alignas(64) static unsigned char memory[sizeof(Run<Task>) + MOST_BUFFER * sizeof(Task::Transition)];
static Run<Task> &run = *(Run<Task> *)memory;
alignas(64) static float noise[MOST_COMPONENTS * LANES * D], uniforms[LANES + BATCH], motion[LANES];
alignas(64) static float factors[MOST_COMPONENTS * D * D], driver[D][LANES], wheel[D][LANES];
static float reached[Task::OBS], stage[Task::OBS];
static Task::Transition latest;
static struct { Words word[4]; } generator;

// The module has no library: sin x, and cos x, by their series around the nearest multiple of pi.
extern "C" float sinf(float x) {
  double turns = x * 0.31830988618379067, r = turns - (int)(turns + (turns < 0 ? -0.5 : 0.5));
  r *= 3.141592653589793;
  double term = r, total = r;
  for (int i = 2; i < 16; i += 2) total += term *= -r * r / (i * (i + 1));
  return (int)(turns + (turns < 0 ? -0.5 : 0.5)) & 1 ? -total : total;
}
extern "C" float cosf(float x) { return sinf(x + 1.57079633f); }

// xoshiro128++, sixteen side by side. Source: Blackman and Vigna (2021).
__attribute__((noinline)) static Lanes uniform() {
  Words *s = generator.word, sum = s[0] + s[3], shifted = s[1] << 9;
  Words result = (sum << 7 | sum >> 25) + s[0];
  s[2] ^= s[0], s[3] ^= s[1], s[1] ^= s[2], s[0] ^= s[3];
  s[2] ^= shifted, s[3] = s[3] << 11 | s[3] >> 21;
  return __builtin_convertvector((Bits)(result >> 8), Lanes) * 0x1p-24f;
}

// Standard normal numbers, by the inverse of their distribution function. Source: Giles (2012).
__attribute__((noinline)) static Lanes normal() {
  const float middle[] = {3.43273939e-7f,  -3.5233877e-6f,  -4.39150654e-6f, 2.1858087e-4f,
                          -1.25372503e-3f, -4.17768164e-3f, 2.46640727e-1f,  1.50140941f};
  const float tail[] = {1.00950558e-4f,  1.34934322e-3f, -3.67342844e-3f, 5.73950773e-3f,
                        -7.6224613e-3f, 9.43887047e-3f, 1.00167406f,     2.83297682f};
  Lanes u = uniform() * 2.0f - (1 - 0x1p-24f), w = -logarithm((1.0f - u) * (1.0f + u));
  Lanes root = __builtin_elementwise_sqrt(w) - 3.0f, p = all(2.81022636e-8f), q = all(-2.00214257e-4f);
  for (int i = 0; i < 8; i++) p = p * (w - 2.5f) + middle[i], q = q * root + tail[i];
  return select(w < 5.0f, p, q) * u * 1.41421356f;
}

static Random draw() {
  int normals = run.s.family == LEARNER ? 0 : run.s.updates * run.s.components * (run.s.n_samples + 1) * D;
  for (int i = 0; i < normals; i += LANES) at(noise + i) = normal();
  for (int i = 0; i < LANES + run.s.updates * run.s.minibatch; i += LANES) at(uniforms + i) = uniform();
  at(motion) = normal();
  return {noise, uniforms, uniforms + LANES, motion, uniforms + 1, uniforms + 3};
}

// Where a page writes what a run begins with, or a driver, and reads what became of them.
extern "C" void *place(int what) {
  void *const places[] = {&run.s,          run.mu, run.sources, run.W, factors, reached,
                          run.observation, driver, stage,       wheel};
  return places[what];
}

extern "C" void begin_run(uint32_t seed) {
  for (Words &word : generator.word)
    for (int i = 0; i < LANES; i++) {
      uint32_t x = seed += 0x9e3779b9;  // splitmix's sequence, through the finaliser of MurmurHash3
      x = (x ^ x >> 16) * 0x85ebca6b, x = (x ^ x >> 13) * 0xc2b2ae35, word[i] = x ^ x >> 16;
    }
  Random random = draw();
  begin(run, factors, random.noise, random.start);
}

// One iteration, of the weights at the wheel if they are to act; whether the episode goes on (0), is over
// in time (1), or by what happened (2).
extern "C" int iterate_run(int driven) {
  for (int i = 0; i < Task::OBS; i++) reached[i] = run.observation[i];
  iterate(run, 1, draw(), driven ? wheel : nullptr);
  // where the step led: an episode's last state is overwritten by the first of the next
  typename Task::Transition t = run.memory[(run.steps - 1) % run.s.buffer];
  bool terminated = Task::move(run.s, reached, motion, t);
  return run.time ? 0 : 1 + terminated;
}
extern "C" float learning() { return learning_return(run); }
extern "C" float earned() { return run.returns[(run.finished - 1) % WINDOW]; }
// The most that the weights at the wheel expect from where the run is.
extern "C" float promise() {
  float most;
  Task::greedy(wheel, run.observation, &most);
  return most;
}
extern "C" void unpack(int c) { copy_factor<false>(D, factors + c * D * D, run.L[c]); }

// One step on the stage, by an action, or by the driver's greedy one if that is negative: the action,
// and 256 more where the episode is over by it.
extern "C" int step_stage(int action) {
  at(motion) = normal();
  latest.action = action < 0 ? Task::greedy(driver, stage) : action;
  return latest.action | Task::move(run.s, stage, motion, latest) << 8;
}
