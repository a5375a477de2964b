// Whole runs in each environment, as Python calls them.
#include "networks.h"
#include "rooms.h"

#define KERNEL(name, Task)                                                                    \
  extern "C" int64_t name##_bytes(int32_t buffer) {                                           \
    return sizeof(Run<Task>) + buffer * sizeof(Task::Transition);                             \
  }                                                                                           \
  extern "C" int32_t name##_weights() { return Task::D; }                                     \
  extern "C" void *name##_place(Run<Task> *run, int32_t what) {                               \
    void *const places[] = {&run->s, run->mu, run->sources, run->W, run->L, run->observation}; \
    return places[what];                                                                      \
  }                                                                                           \
  extern "C" void name##_begin(Run<Task> *run, float *L, const float *noise, const float *u) { \
    begin(*run, L, noise, u);                                                                 \
  }                                                                                           \
  extern "C" void name##_iterate(Run<Task> *run, int32_t count, const Random *random) {       \
    iterate(*run, count, *random);                                                            \
  }                                                                                           \
  extern "C" float name##_learning(const Run<Task> *run) { return learning_return(*run); }

KERNEL(rooms, Rooms)
KERNEL(cartpole, Cartpole)
KERNEL(mountain_car, MountainCar)
