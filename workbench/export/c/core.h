/* One instance of the model: values in and out, checks, steps. No globals, and no memory is taken in a step. */
#ifndef WORKBENCH_CORE_H
#define WORKBENCH_CORE_H

#include "model.h"

/* The numbers of FMI's own status. */
enum status { OK, WARNING, DISCARD, ERROR, FATAL };
enum phase { INSTANTIATED, INITIALISING, STEPPING, TERMINATED };

/* Everything that a stored state holds: plain numbers, so it is copied and written out as it is. */
typedef struct {
    int phase;
    int given;                  /* the first input has been set */
    double start_time, time;
    long long sample;           /* of the controller: how many have passed */
    double hold, actual, command;
    double p[N_PARAMETERS], w[N_INPUTS], w_rate, s[N_STATES], memory[N_MEMORY + 1];
} State;

typedef void (*Log)(void *who, int status, const char *category, const char *message);

typedef struct {
    State now;
    double c[N_CONSTANTS + 1], shown[N_SHOWN];
    int stale;                  /* `shown` is older than the state or the inputs */
    Log log;
    void *who;
} Core;

void core_reset(Core *m);
int core_enter(Core *m, double start_time, int stop_defined, double stop_time);
int core_exit(Core *m);
int core_get(Core *m, unsigned reference, int type, double *value);
int core_set(Core *m, unsigned reference, int type, double value);
int core_rate(Core *m, unsigned reference, int order, double value);
int core_step(Core *m, double from, double length);
int core_derivative(Core *m, const unsigned *unknowns, size_t n, const unsigned *knowns, size_t k,
                    const double *seed, double *sensitivity, int adjoint);
int core_restore(Core *m, const State *state);
int core_say(Core *m, int status, const char *format, ...);

#endif
