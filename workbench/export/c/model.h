/* What the generated model.c gives: the numbers of one machine and the straight-line functions of its physics. */
#ifndef WORKBENCH_MODEL_H
#define WORKBENCH_MODEL_H

#include <stddef.h>

#include "sizes.h"

enum kind { KIND_TIME, KIND_INPUT, KIND_PARAMETER, KIND_SHOWN };
enum type { TYPE_REAL, TYPE_BOOLEAN };

typedef struct {
    const char *name;
    int kind;      /* where its value is kept, at `index` there */
    int index;
    int type;
    int tunable;   /* a parameter that may change while the model runs */
    int whole;     /* takes whole numbers only */
    double start;
    double lowest, highest;
    int above;     /* the lowest value itself is not allowed */
    int below;     /* nor is the highest */
} Variable;

/* Parameter `smaller` has to stay below parameter `larger`; `equal`: or to be equal to it. */
typedef struct { int smaller, larger, equal; } Order;

extern const Variable model_variables[N_VARIABLES];
extern const Order model_orders[N_ORDERS + 1];
extern const int model_knowns[N_KNOWNS + 1];   /* variables that derivatives are taken by: states, then inputs */
extern const int model_unknowns[N_UNKNOWNS + 1];  /* variables whose derivatives are known: outputs, then state derivatives */

/* All arrays are the caller's. p: parameters, c: what the steps read of them, w: inputs, s: states, positions first. */
void model_constants(const double *p, double *c);
void model_step(const double *c, const double *w, double t, double h, double u, double u_rate, const double *s, double *next);
void model_shown(const double *c, const double *w, double t, double u, const double *s, double *out);
void model_first(const double *c, double at, double speed, double *s, double *hold);
void model_balance(const double *c, double t, double hold, const double *s, double *out);
void model_slopes(const double *c, const double *w, double t, double u, const double *s, double *out);
#if N_MEMORY > 0
void model_control(const double *c, const double *w, double t, double u, double hold, const double *s, const double *memory,
                   double *next);
void model_control_start(const double *c, double hold, double angle, double *memory);
void model_lag(const double *c, double *lag);
#endif

#endif
