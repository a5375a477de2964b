// The rooms: a Q-function linear in 121 radial bases for each of 4 actions.
#pragma once
#include "algorithm.h"

struct Rooms {
  static constexpr int GRID = 11, ACTIONS = 4, BASES = GRID * GRID, D = ACTIONS * BASES;
  static constexpr int OBS = 2, NOISE = 2, START = 2, HORIZON = 50;
  static constexpr int PATCH = 4;  // bases along an axis that are not rounded to zero

  // The bases of one position that are not zero: a patch of the grid, as products of two axes.
  struct Features {
    float axis[2][PATCH];
    int first;  // index of the patch's lowest basis
  };
  struct Transition {
    Features now, next;
    float reward, alive;
    int action;
  };

  static void start(const Settings &s, float *position, const float *u) {
    for (int i = 0; i < 2; i++) position[i] = s.task[3] ? 10 * u[i] : 0;  // anywhere, or the corner
  }

  static Features features(const float *position) {
    Features f;
    int corner[2];
    for (int axis = 0; axis < 2; axis++) {
      Lanes apart = position[axis] - Lanes{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 99, 99, 99, 99, 99};
      float top = position[axis] - (int)(position[axis] + 0.5f), total = 0;
      Lanes basis = exponential(larger(apart * apart * -4.5f + 4.5f * top * top, all(-30)));
      for (int i = 0; i < GRID; i++) total += basis[i];
      int low = (int)position[axis] - 1;  // bases further off than 1.9 are rounded to zero
      low = low < 0 ? 0 : low > GRID - PATCH ? GRID - PATCH : low;
      for (int i = 0; i < PATCH; i++) {
        float share = basis[low + i] / total;
        f.axis[axis][i] = share > 1e-7f ? share : 0;
      }
      corner[axis] = low;
    }
    f.first = corner[0] * GRID + corner[1];
    return f;
  }

  // Q-values of all samples for one action.
  static Lanes value(const float (*w)[LANES], const Features &f, int action) {
    Lanes total = {};
    for (int i = 0; i < PATCH; i++) {
      Lanes along = {};
      const float(*basis)[LANES] = w + action * BASES + f.first + i * GRID;
      for (int j = 0; j < PATCH; j++) along += f.axis[1][j] * at(basis[j]);
      total += f.axis[0][i] * along;
    }
    return total;
  }

  static void pull_back(float (*g)[LANES], const Features &f, int action, Lanes cotangent) {
    for (int i = 0; i < PATCH; i++) {
      Lanes along = cotangent * f.axis[0][i];
      float(*basis)[LANES] = g + action * BASES + f.first + i * GRID;
      for (int j = 0; j < PATCH; j++) at(basis[j]) += f.axis[1][j] * along;
    }
  }

  // Gradients of the mean squared mellow TD error at all samples of a component, eq. 5.4.
  static void td_gradients(Run<Rooms> &run, int c, const float *u, float weight) {
    const Settings &s = run.s;
    for (int i = 0; i < D; i++) at(run.gradient[i]) = Lanes{};
    for (int b = 0; b < s.minibatch; b++) {
      const Transition &t = remembered(run, u[b]);
      Lanes q[ACTIONS], error = t.reward - value(run.samples[c], t.now, t.action);
      for (int a = 0; a < ACTIONS; a++) q[a] = value(run.samples[c], t.next, a);
      error += s.gamma * t.alive * mellow(q, s.kappa);
      error *= 2.0f / s.minibatch * weight;
      pull_back(run.gradient, t.now, t.action, -error);
      for (int a = 0; a < ACTIONS && t.alive > 0; a++)
        pull_back(run.gradient, t.next, a, q[a] * error * (s.gamma * s.psi));
    }
  }

  // The best action of the first sample, and its value.
  static int greedy(const float (*w)[LANES], const float *position, float *most = nullptr) {
    Features f = features(position);
    int best = 0;
    for (int a = 1; a < ACTIONS; a++)
      if (value(w, f, a)[0] > value(w, f, best)[0]) best = a;
    if (most) *most = value(w, f, best)[0];
    return best;
  }

  // Moves the agent; every sum and product is rounded by itself, as in vtlab.envs.rooms.
  static bool move(const Settings &s, float *from, const float *motion, Transition &t) {
#pragma clang fp contract(off)
    const float moves[ACTIONS][2] = {{0, 1}, {1, 0}, {0, -1}, {-1, 0}};
    int walls = (int)s.task[2];
    float to[2];
    bool blocked = false;
    t.now = features(from);
    for (int i = 0; i < 2; i++) {
      float jolt = 0.2f * motion[i], aim = (from[i] + moves[t.action][i]) + jolt;
      to[i] = aim < 0 ? 0 : aim > 10 ? 10 : aim;
      blocked |= s.task[4] && to[i] != aim;  // the frontier stops the agent, or lets it slide
    }
    for (int w = 0; w < walls; w++) {
      float wall = 10.0f * (w + 1) / (walls + 1), dx = to[0] - from[0], dy = to[1] - from[1];
      if ((from[1] < wall) == (to[1] < wall)) continue;
      float share = (wall - from[1]) / dy, along = dx * share, off = (from[0] + along) - s.task[w];
      blocked |= off > 0.5f || off < -0.5f;  // a door is 1 wide
    }
    for (int i = 0; i < 2 && !blocked; i++) from[i] = to[i];
    float x = 10 - from[0], y = 10 - from[1], xx = x * x, yy = y * y;
    bool goal = xx + yy <= 1;
    t.next = features(from);
    t.reward = goal, t.alive = !goal;
    return goal;
  }
};
