// Cartpole and mountain car: networks with one hidden layer of ReLUs. Sixteen states pass through a
// network side by side; the weights of a sample are single numbers.
#pragma once
#include "algorithm.h"

template <class Body, int IN, int HIDDEN, int OUT> struct Network {
  static constexpr int OBS = IN, ACTIONS = OUT, FIRST = HIDDEN * IN, SECOND = FIRST + HIDDEN;
  static constexpr int LAST = SECOND + OUT * HIDDEN, D = LAST + OUT;
  static constexpr int NOISE = 0;
  static constexpr int MOST_BATCH = 512, GROUPS = MOST_BATCH / LANES;

  struct Transition {
    float now[IN], next[IN], reward, alive;
    int action;
  };

  // A minibatch in columns, those of next states behind those of states.
  struct Batch {
    alignas(64) float obs[IN][2 * MOST_BATCH], cotangent[OUT][2 * MOST_BATCH];
    float reward[MOST_BATCH], alive[MOST_BATCH], action[MOST_BATCH];
  };

  static Lanes hidden(const float (*w)[LANES], int k, int unit, const Lanes *x) {
    Lanes h = all(w[FIRST + unit][k]);
    for (int i = 0; i < IN; i++) h += w[unit * IN + i][k] * x[i];
    return larger(h, Lanes{});
  }

  static void values(const float (*w)[LANES], int k, const Lanes *x, Lanes (&q)[OUT]) {
    for (int a = 0; a < OUT; a++) q[a] = all(w[LAST + a][k]);
    for (int unit = 0; unit < HIDDEN; unit++) {
      Lanes h = hidden(w, k, unit, x);
      for (int a = 0; a < OUT; a++) q[a] += w[SECOND + a * HIDDEN + unit][k] * h;
    }
  }

  // Derivatives of the mean squared mellow TD error by the Q-values of one sample, eq. 5.4.
  static void cotangents(const Settings &s, const float (*w)[LANES], int k, float weight, Batch &b) {
    for (int g = 0; g * LANES < s.minibatch; g++) {
      int now = g * LANES, next = MOST_BATCH + now;
      Lanes x[IN], y[IN], q[OUT], following[OUT], chosen = {}, action = at(b.action + now);
      for (int i = 0; i < IN; i++) x[i] = at(b.obs[i] + now), y[i] = at(b.obs[i] + next);
      values(w, k, x, q);
      values(w, k, y, following);
      for (int a = 0; a < OUT; a++) chosen = select(action == (float)a, q[a], chosen);
      Lanes flow = s.gamma * at(b.alive + now);
      Lanes error = at(b.reward + now) + flow * mellow(following, s.kappa) - chosen;
      // beyond the minibatch there is nothing, and no action
      error = select(action >= 0.0f, error * (2.0f / s.minibatch * weight), Lanes{});
      for (int a = 0; a < OUT; a++) {
        at(b.cotangent[a] + now) = select(action == (float)a, -error, Lanes{});
        at(b.cotangent[a] + next) = following[a] * error * flow * s.psi;
      }
    }
  }

  static void pull_back(const Settings &s, const float (*w)[LANES], int k, const Batch &b,
                        float (*g)[LANES]) {
    for (int unit = 0; unit < HIDDEN; unit++) {
      Lanes into[IN] = {}, bias = {}, out[OUT] = {};
      for (int half = 0; half < (s.psi > 0 ? 2 : 1); half++)
        for (int group = 0; group * LANES < s.minibatch; group++) {
          int here = half * MOST_BATCH + group * LANES;
          Lanes x[IN], back = {};
          for (int i = 0; i < IN; i++) x[i] = at(b.obs[i] + here);
          Lanes h = hidden(w, k, unit, x);
          for (int a = 0; a < OUT; a++) {
            out[a] += at(b.cotangent[a] + here) * h;
            back += w[SECOND + a * HIDDEN + unit][k] * at(b.cotangent[a] + here);
          }
          back = select(h > 0.0f, back, Lanes{});
          bias += back;
          for (int i = 0; i < IN; i++) into[i] += back * x[i];
        }
      for (int i = 0; i < IN; i++) g[unit * IN + i][k] = sum(into[i]);
      g[FIRST + unit][k] = sum(bias);
      for (int a = 0; a < OUT; a++) g[SECOND + a * HIDDEN + unit][k] = sum(out[a]);
    }
    for (int a = 0; a < OUT; a++) {
      Lanes total = {};
      for (int i = 0; i < 2 * MOST_BATCH; i += LANES)
        if (i % MOST_BATCH < s.minibatch) total += at(b.cotangent[a] + i);
      g[LAST + a][k] = sum(total);
    }
  }

  static void td_gradients(Run<Body> &run, int c, const float *u, float weight) {
    static thread_local Batch b;
    const Settings &s = run.s;
    for (int i = 0; i < MOST_BATCH; i++) b.action[i] = -1;
    for (int i = 0; i < s.minibatch; i++) {
      const Transition &t = remembered(run, u[i]);
      for (int j = 0; j < IN; j++) b.obs[j][i] = t.now[j], b.obs[j][MOST_BATCH + i] = t.next[j];
      b.reward[i] = t.reward, b.alive[i] = t.alive, b.action[i] = t.action;
    }
    int first = s.family == LEARNER ? 0 : 1, last = s.family == LEARNER ? 0 : s.n_samples;
    for (int k = first; k <= last; k++) {
      cotangents(s, run.samples[c], k, weight, b);
      pull_back(s, run.samples[c], k, b, run.gradient);
    }
  }

  static int greedy(const float (*w)[LANES], const float *observation, float *most = nullptr) {
    Lanes x[IN], q[OUT];
    int best = 0;
    for (int i = 0; i < IN; i++) x[i] = all(observation[i]);
    values(w, 0, x, q);
    for (int a = 1; a < OUT; a++)
      if (q[a][0] > q[best][0]) best = a;
    if (most) *most = q[best][0];
    return best;
  }

  static bool move(const Settings &s, float *state, const float *, Transition &t) {
    for (int i = 0; i < IN; i++) t.now[i] = state[i];
    bool terminated = Body::step(s.task, state, t.action, t.reward);
    for (int i = 0; i < IN; i++) t.next[i] = state[i];
    t.alive = !terminated;
    return terminated;
  }
};

// task: mass of the cart, mass of the pole, half its length.
struct Cartpole : Network<Cartpole, 4, 32, 2> {
  static constexpr int START = 4, HORIZON = 100;
  static void start(const Settings &, float *state, const float *u) {
    for (int i = 0; i < 4; i++) state[i] = 0.05f * (2 * u[i] - 1);
  }
  static bool step(const float *task, float *x, int action, float &reward) {
    float sin = __builtin_sinf(x[2]), cos = __builtin_cosf(x[2]);
    float mass = task[0] + task[1], moment = task[1] * task[2], force = 10.0f * (2 * action - 1);
    float push = (force + moment * (x[3] * x[3]) * sin) / mass;
    float inertia = task[2] * (1.33333333f - task[1] * (cos * cos) / mass);
    float angular = (9.8f * sin - cos * push) / inertia;
    float rates[4] = {x[1], push - moment * angular * cos / mass, x[3], angular};
    for (int i = 0; i < 4; i++) x[i] += 0.02f * rates[i];
    reward = 1;
    const float leaning = 0.20943951f, away = 2.4f;
    return x[2] > leaning || x[2] < -leaning || x[0] > away || x[0] < -away;
  }
};

// task: the velocity that an action adds, and the reward at the goal.
struct MountainCar : Network<MountainCar, 2, 64, 3> {
  static constexpr int START = 1, HORIZON = 200;
  static void start(const Settings &, float *state, const float *u) {
    state[0] = -0.9f + 0.9f * u[0], state[1] = 0;
  }
  static bool step(const float *task, float *x, int action, float &reward) {
    x[1] += (action - 1) * task[0] - 0.0025f * __builtin_cosf(3 * x[0]);
    x[1] = bounded(x[1], 0.07f);
    x[0] += x[1];
    x[0] = x[0] < -1.2f ? -1.2f : x[0] > 0.6f ? 0.6f : x[0];
    bool goal = x[0] >= 0.5f;
    if (x[0] <= -1.2f && x[1] < 0) x[1] = 0;
    reward = goal ? task[1] : -1;
    return goal;
  }
};
