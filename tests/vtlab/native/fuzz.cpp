// Runs the kernels on settings drawn at random, with every array as long as it has to be and no
// longer: `make sanitize` compiles this with the sanitizers of addresses and undefined behaviour.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <vector>

#include "../../../book/vtlab/native/runs.cpp"
#include "../../../vtlib/native/posterior.cpp"

static std::mt19937 source(0);
static int whole(int least, int most) { return std::uniform_int_distribution<int>(least, most)(source); }
static float real(float low, float high) { return std::uniform_real_distribution<float>(low, high)(source); }

static std::vector<float> numbers(int64_t count, bool normal, float scale = 1) {
  std::vector<float> found(count);
  std::normal_distribution<float> bell;
  for (float &x : found) x = scale * (normal ? bell(source) : real(0, 0.99999994f));
  return found;
}

static float *lines(int64_t floats) {  // whole lines of the cache, as torch's memory begins with one
  int64_t bytes = (floats * 4 + 63) / 64 * 64;
  return (float *)std::memset(std::aligned_alloc(64, bytes), 0, bytes);
}

template <class Task> static bool a_run(const float *task) {
  constexpr int D = Task::D;
  Settings s = {};
  s.family = whole(LEARNER, FIXED), s.components = s.family >= MIXTURE ? whole(1, MOST_COMPONENTS) : 1;
  s.sources = whole(1, MOST_SOURCES), s.n_samples = whole(1, LANES - 1);
  s.minibatch = whole(1, 1 << whole(0, 9));  // mostly small: a large one takes long
  s.buffer = whole(1, 80), s.equal = s.family >= MIXTURE && whole(0, 1), s.diagonal_kl = whole(0, 1);
  if (s.equal) s.sources = 1;
  s.epsilon_steps = whole(1, 100), s.epsilon_start = real(0, 1), s.epsilon_end = real(0, 1);
  s.lambda = real(0, 1), s.psi = whole(0, 2) / 2.0f, s.kappa = real(0.1f, 200), s.gamma = real(0, 0.999f);
  s.alpha_mu = real(1e-4f, 1e-2f), s.alpha_L = real(1e-6f, 1e-2f), s.sigma_min = real(1e-6f, 1e-2f);
  s.clip = whole(0, 1) ? 3e38f : real(1, 1000), s.kl_clip = whole(0, 1) ? 3e38f : real(1, 1000);
  s.scale = real(1, 1e5f), s.weight = 1, s.deviation = 0.01f;
  s.updates = s.family == FIXED ? whole(1, 8) : 1, s.patience = s.family == FIXED ? whole(0, 40) : 0;
  std::memcpy(s.task, task, sizeof s.task);
  int64_t bytes = sizeof(Run<Task>) + s.buffer * sizeof(typename Task::Transition);
  void *memory = std::aligned_alloc(64, (bytes + 63) / 64 * 64);
  std::memset(memory, 0, bytes);
  Run<Task> &run = *(Run<Task> *)memory;
  run.s = s;
  for (auto *rows : {run.mu, run.sources, run.W})
    for (int i = 0; i < (rows == run.mu ? MOST_COMPONENTS : MOST_SOURCES); i++)
      for (int j = 0; j < D; j++) rows[i][j] = real(-0.1f, 0.1f);
  int C = s.components, iterations = 120, samples = s.family == LEARNER ? 0 : C * (s.n_samples + 1) * D;
  std::vector<float> L((int64_t)C * D * D);
  for (int c = 0; c < C; c++)
    for (int i = 0; i < D; i++)
      for (int j = 0; j <= i; j++) L[((int64_t)c * D + i) * D + j] = i == j ? 0.05f : real(-1e-3f, 1e-3f);
  auto noise = numbers(samples, true), start = numbers(Task::START, false);
  begin(run, L.data(), noise.data(), start.data());
  for (int done = 0; done < iterations;) {
    int count = whole(1, 16);
    auto z = numbers((int64_t)count * s.updates * samples, true), motion = numbers(count * Task::NOISE, true);
    auto component = numbers(C > 1 ? count : 0, false), replay = numbers(count * s.updates * s.minibatch, false);
    auto starts = numbers(count * Task::START, false);
    auto chance = numbers(s.family == LEARNER ? 2 * count : 0, false);
    iterate(run, count, {z.data(), component.data(), replay.data(), motion.data(), starts.data(), chance.data()});
    done += count;
  }
  bool finite = std::isfinite(learning_return(run)) && std::isfinite(run.mu[0][0]);
  std::free(memory);
  return finite;
}

// The posterior's step alone, in one pass and in blocks, for any number of weights.
static void a_posterior() {
  int d = whole(1, 90), n = whole(1, LANES - 1), members = whole(1, 3), count = n + 1, wide = padded(d);
  int sources = whole(0, MOST_SOURCES);
  Descent f = {d, n, sources, whole(0, 1), 1e-3f, 1e-4f, 3e38f, 3e38f, 10.0f};
  std::vector<float> rows((int64_t)d * d, 0.01f);
  float *L = lines(members * factor_size(d)), *W = lines(members * sources * wide);
  float *WL = lines(members * sources * wide);
  for (int m = 0; m < members; m++) posterior_pack(d, rows.data(), L + m * factor_size(d));
  auto gradients = numbers((int64_t)members * n * d, true), z = numbers(gradients.size(), true);
  auto noise = numbers((int64_t)members * count * d, true), out = numbers(noise.size(), false);
  for (int step = 0; step < 3; step++)
    posterior_step(&f, members, count, L, W, WL, gradients.data(), z.data(), noise.data(),
                   out.data(), 0.1f, step > 0);
  posterior_unpack(d, rows.data(), L);
  std::free(L), std::free(W), std::free(WL);
}

static void a_posterior_in_blocks() {
  int d = whole(1, 120), n = whole(1, LANES - 1), members = whole(1, 3), count = n + 1;
  int groups = DRAWS / count;
  Descent f = {d, n, 0, 1, 1e-3f, 1e-4f, whole(0, 1) ? 3e38f : 1.0f, 3e38f, 10.0f};
  std::vector<float> rows((int64_t)d * d, 0.01f);
  float *memory = lines(members * blocks_size(d));
  for (int m = 0; m < members; m++) blocks_pack(d, rows.data(), memory + m * blocks_size(d));
  auto precision = numbers((int64_t)members * d, false), out = numbers((int64_t)members * count * d, false);
  for (int block = 0; block < 2; block++) {
    auto noise = numbers((int64_t)groups * members * count * d, true);
    blocks_begin(d, members, groups, count, memory, noise.data());
    for (int t = 0; t < groups; t++) {
      auto gradients = numbers((int64_t)members * n * d, true);
      blocks_product(d, members, t, count, memory, out.data());
      blocks_step(&f, members, t, count, memory, precision.data(), gradients.data(), 0.1f);
    }
  }
  for (int m = 0; m < members; m++) blocks_unpack(d, rows.data(), memory + m * blocks_size(d));
  std::free(memory);
}

int main(int, char **given) {
  int runs = std::atoi(given[1]), finite = 0;
  for (int i = 0; i < runs; i++) {
    const float rooms[] = {real(0, 10), real(0, 10), (float)whole(1, 2), (float)whole(0, 1), (float)whole(0, 1)};
    const float pole[] = {real(0.5f, 1.5f), real(0.1f, 0.3f), real(0.2f, 0.8f), 0, 0};
    const float car[] = {real(0.001f, 0.0015f), (float)-whole(0, 1), 0, 0, 0};
    finite += a_run<Rooms>(rooms) + a_run<Cartpole>(pole) + a_run<MountainCar>(car);
    for (int j = 0; j < 10; j++) a_posterior(), a_posterior_in_blocks();
  }
  std::printf("%d runs and %d posteriors, nothing found; %d runs stayed finite\n", 3 * runs, 20 * runs, finite);
}
