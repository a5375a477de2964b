// Algorithm 1, one run at a time, for a Q-function and an environment that `Task` supplies:
// vtlib/algorithm1.py says the same in the order of the thesis. Random numbers come in from outside.
#pragma once
#include "factor.h"

// A learner is mellow TD without transfer; of a fixed mixture the means alone are learned.
enum Family { LEARNER, GAUSSIAN, MIXTURE, FIXED };
constexpr int MOST_COMPONENTS = 3, MOST_SOURCES = 10, WINDOW = 50;

// Plain numbers, by the names of vtlib.transfer.Settings. weight is that of the TD error, and deviation
// that of a fixed mixture; updates are the gradient steps for each step of the task.
struct Settings {
  int32_t family, components, sources, n_samples, minibatch, buffer, equal, diagonal_kl, epsilon_steps;
  int32_t updates, patience;
  float lambda, psi, kappa, gamma, alpha_mu, alpha_L, sigma_min, clip, kl_clip, scale;
  float epsilon_start, epsilon_end, weight, deviation, task[5];  // what tells the task apart
};

// Random numbers of each role, as many as the iterations ask for.
struct Random {
  const float *noise, *component, *replay, *motion, *start, *exploration;
};

template <class Task> struct Run {
  static constexpr int D = Task::D, WIDE = padded(D);
  Settings s;
  int64_t steps;
  int32_t time, finished;
  float running, discount, returns[WINDOW], observation[Task::OBS];
  alignas(64) float mu[MOST_COMPONENTS][WIDE];
  float m[MOST_COMPONENTS][WIDE], v[MOST_COMPONENTS][WIDE];  // Adam's moments
  float sources[MOST_SOURCES][WIDE];                         // of a Gaussian, their mean alone
  float W[MOST_SOURCES][WIDE], WL[MOST_SOURCES][WIDE];  // precision scale * (I - W W^T), and W^T L
  float L[MOST_COMPONENTS][factor_size(D)], next[MOST_SOURCES][WIDE];
  float z[MOST_COMPONENTS][LANES][WIDE];        // the noise of the present samples
  float samples[MOST_COMPONENTS][WIDE][LANES];  // of each weight the samples, side by side
  float gradient[WIDE][LANES], upcoming[WIDE][LANES];
  typename Task::Transition memory[];
};

// The next samples w = L z + mu of a component, from n_samples + 1 rows of noise (eq. 5.10).
template <class Task> void sample(Run<Task> &run, int c, const float *noise, bool step, float pull) {
  constexpr int D = Task::D;
  int count = run.s.n_samples + 1;
  for (int i = 0; i < D; i++)
    for (int k = 0; k < count; k++) run.upcoming[i][k] = noise[k * D + i];
  const Settings &s = run.s;
  if (s.family == FIXED) {
    for (int i = 0; i < D; i++) at(run.samples[c][i]) = run.mu[c][i] + s.deviation * at(run.upcoming[i]);
    return;
  }
  int sources = s.family == GAUSSIAN ? s.sources : 0;
  Descent f = {D, s.n_samples, sources, s.diagonal_kl, s.alpha_L, s.sigma_min, s.clip, s.kl_clip, s.scale};
  step_and_multiply(f, run.L[c], run.W[0], run.WL[0], run.next[0], run.gradient, run.z[c][0],
                    run.upcoming, run.samples[c], pull, step);
  for (int i = 0; i < D; i++) at(run.samples[c][i]) += run.mu[c][i];
  for (int k = 0; k < count; k++)
    for (int i = 0; i < D; i++) run.z[c][k][i] = noise[k * D + i];
}

// theta of eqs. 5.14 and 5.15, in logarithms, from the KLs of C components from S sources.
static void responsibilities(int C, int S, const double *kl, double *theta) {
  double phi[MOST_COMPONENTS * MOST_SOURCES] = {};
  for (int update = 0; update <= (C > 1 ? 50 : 0); update++) {
    double change = 0;
    for (int c = 0; c < C; c++) {
      double row[MOST_SOURCES];
      for (int j = 0; j < S; j++) row[j] = phi[c * S + j] - kl[c * S + j];
      double total = log_of_sum(row, S, 1) + log_of(C);
      for (int j = 0; j < S; j++) {
        double moved = exp_of(row[j] - total) - (update ? exp_of(theta[c * S + j]) : 0);
        theta[c * S + j] = row[j] - total;
        change = moved > change ? moved : -moved > change ? -moved : change;
      }
    }
    if (update && change < 1e-6) break;
    for (int j = 0; j < S; j++) {
      double total = log_of_sum(theta + j, C, S) + log_of(S);
      for (int c = 0; c < C; c++) phi[c * S + j] = theta[c * S + j] - total;
    }
  }
}

// Gradient of the divergence with respect to the means: eq. 5.8, or that of the bound of eq. 5.13.
template <class Task> void pull_of_prior(const Run<Task> &run, float (*pull)[padded(Task::D)]) {
  constexpr int WIDE = padded(Task::D);
  const Settings &s = run.s;
  if (s.family == GAUSSIAN) {
    alignas(64) float x[WIDE];
    for (int i = 0; i < WIDE; i++) pull[0][i] = x[i] = run.mu[0][i] - run.sources[0][i];
    for (int j = 0; j < s.sources; j++) {
      Lanes along = {};
      for (int i = 0; i < WIDE; i += LANES) along += at(run.W[j] + i) * at(x + i);
      for (int i = 0; i < WIDE; i += LANES) at(pull[0] + i) -= sum(along) * at(run.W[j] + i);
    }
    for (int i = 0; i < WIDE; i++) pull[0][i] *= s.scale;
    return;
  }
  double kl[MOST_COMPONENTS * MOST_SOURCES], theta[MOST_COMPONENTS * MOST_SOURCES];
  for (int c = 0; c < s.components; c++)
    for (int j = 0; j < s.sources; j++) {
      Lanes total = {};
      for (int i = 0; i < WIDE; i += LANES) {
        Lanes apart = at(run.mu[c] + i) - at(run.sources[j] + i);
        total += apart * apart;
      }
      kl[c * s.sources + j] = sum(total) * 0.5 * s.scale;
    }
  if (!s.equal) responsibilities(s.components, s.sources, kl, theta);
  for (int c = 0; c < s.components; c++) {
    for (int i = 0; i < WIDE; i++) pull[c][i] = 0;
    for (int j = 0; j < s.sources; j++) {
      double share = s.equal ? 1.0 / (s.components * s.sources) : exp_of(theta[c * s.sources + j]);
      if (share * s.scale < 1e-30) continue;
      for (int i = 0; i < WIDE; i++)
        pull[c][i] += (float)share * s.scale * (run.mu[c][i] - run.sources[j][i]);
    }
  }
}

// One step of Adam on the means of a component, along a clipped gradient.
template <class Task> void adam(Run<Task> &run, int c, const float *slope, const double *powers) {
  float rate = run.s.alpha_mu / (1 - powers[0]), root = __builtin_sqrt(1 - powers[1]);
  for (int i = 0; i < Task::D; i++) {
    float g = bounded(slope[i], run.s.clip);
    run.m[c][i] += 0.1f * (g - run.m[c][i]);
    run.v[c][i] = 0.999f * run.v[c][i] + 0.001f * g * g;
    run.mu[c][i] -= rate * run.m[c][i] / (__builtin_sqrtf(run.v[c][i]) / root + 1e-8f);
  }
}

template <class Task> void copy_means(Run<Task> &run) {  // a learner's weights, as if sampled
  for (int i = 0; i < Task::D; i++) at(run.samples[0][i]) = all(run.mu[0][i]);
}

template <class Task> void begin_episode(Run<Task> &run, const float *u) {
  Task::start(run.s, run.observation, u);
  run.time = 0, run.running = 0, run.discount = 1;
}

// Begins a run whose settings, means, sources and W are set; L comes in as rows (C, D, D).
template <class Task> void begin(Run<Task> &run, float *L, const float *noise, const float *u) {
  constexpr int D = Task::D;
  begin_episode(run, u);
  if (run.s.family == LEARNER) return copy_means(run);
  for (int c = 0; c < run.s.components; c++) {
    copy_factor<true>(D, L + (int64_t)c * D * D, run.L[c]);
    sample(run, c, noise + (int64_t)c * (run.s.n_samples + 1) * D, false, 0);
  }
}

// One gradient step on a minibatch.
template <class Task> void learn(Run<Task> &run, Random &random, const double *powers) {
  constexpr int D = Task::D;
  const Settings &s = run.s;
  alignas(64) float pull[MOST_COMPONENTS][padded(D)], slope[padded(D)];
  if (s.family == LEARNER) {
    Task::td_gradients(run, 0, random.replay, 1);
    for (int j = 0; j < D; j++) slope[j] = run.gradient[j][0];
    adam(run, 0, slope, powers);
    copy_means(run);
  } else {
    float weight = s.lambda / run.steps;
    pull_of_prior(run, pull);
    for (int c = 0; c < s.components; c++) {
      Task::td_gradients(run, c, random.replay, s.weight / (s.components * s.n_samples));
      for (int j = 0; j < D; j++) {
        slope[j] = weight * pull[c][j];
        for (int k = 1; k <= s.n_samples; k++) slope[j] += run.gradient[j][k];
      }
      adam(run, c, slope, powers);
      sample(run, c, random.noise, true, weight / s.components);
      random.noise += (s.n_samples + 1) * D;
    }
  }
  random.replay += s.minibatch;
}

// Iterations of a run: act, step, learn. Weights at the wheel act in place of a sample.
template <class Task>
void iterate(Run<Task> &run, int iterations, Random random, const float (*wheel)[LANES] = nullptr) {
  const Settings &s = run.s;
  int64_t taken = run.steps > s.patience ? s.updates * (run.steps - s.patience) : 0;
  double powers[2] = {power_of(0.9, taken), power_of(0.999, taken)};
  for (int i = 0; i < iterations; i++) {
    typename Task::Transition &t = run.memory[run.steps % s.buffer];
    int acting = s.components > 1 ? (int)(*random.component++ * s.components) : 0;
    t.action = Task::greedy(wheel ? wheel : run.samples[acting], run.observation);
    if (s.family == LEARNER) {
      float progress = (float)run.steps / s.epsilon_steps;
      progress = progress < 1 ? progress : 1;
      float epsilon = s.epsilon_start + progress * (s.epsilon_end - s.epsilon_start);
      if (random.exploration[0] < epsilon) t.action = (int)(random.exploration[1] * Task::ACTIONS);
      random.exploration += 2;
    }
    bool terminated = Task::move(s, run.observation, random.motion, t);
    random.motion += Task::NOISE;
    run.steps++, run.time++;
    run.running += run.discount * t.reward;
    run.discount *= s.gamma;
    if (terminated || run.time >= Task::HORIZON) {
      run.returns[run.finished++ % WINDOW] = run.running;
      begin_episode(run, random.start);
    }
    random.start += Task::START;
    for (int update = 0; update < s.updates && run.steps > s.patience; update++) {
      powers[0] *= 0.9, powers[1] *= 0.999;
      learn(run, random, powers);
    }
  }
}

template <class Task> float learning_return(const Run<Task> &run) {
  int count = run.finished < WINDOW ? run.finished : WINDOW;
  float total = 0;
  for (int i = 0; i < count; i++) total += run.returns[i];
  return total / (count ? count : 1);
}

// A transition of the memory, chosen by a uniform number.
template <class Task> const typename Task::Transition &remembered(const Run<Task> &run, float u) {
  int64_t size = run.steps < run.s.buffer ? run.steps : run.s.buffer, i = (int64_t)(u * (float)size);
  return run.memory[i < size ? i : size - 1];
}

// The mellow value of next states (eq. 5.3), and in q its derivatives by their Q-values.
template <int ACTIONS> Lanes mellow(Lanes (&q)[ACTIONS], float kappa) {
  Lanes top = q[0], total = {};
  for (int a = 1; a < ACTIONS; a++) top = larger(top, q[a]);
  for (int a = 0; a < ACTIONS; a++) {
    Lanes e = exponential(larger(kappa * (q[a] - top), all(-17)));
    // a smaller term is lost in the sum, and its products would become denormal
    total += q[a] = select(e > 1.1920929e-7f, e, Lanes{});
  }
  for (int a = 0; a < ACTIONS; a++) q[a] /= total;
  return top + logarithm(total * (1.0f / ACTIONS)) / kappa;
}
