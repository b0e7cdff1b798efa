/* One instance of the model: values in and out, checks, steps. */
#include "core.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define ROUNDS 50
#define AT_REST 1e-6      /* rad/s^2 or m/s^2: rounding of lengths leaves a thousandth of it */
#define SAME_TIME 1e-6    /* of a step: communication points may be off by rounding */
#define WHOLE 1e-9        /* of a step: lengths that are whole numbers of steps but for rounding */
#define MOST_STATE 1e9    /* in m, rad or per second: no machine's */
#define MOST_STEPS 1e8    /* in one communication step */

int core_say(Core *m, int status, const char *format, ...) {
    char message[400];
    va_list arguments;
    if (m->log) {
        va_start(arguments, format);
        vsnprintf(message, sizeof message, format, arguments);
        va_end(arguments);
        m->log(m->who, status, status == WARNING ? "logStatusWarning" : status == DISCARD ? "logStatusDiscard" : "logStatusError",
               message);
    }
    return status;
}

void core_reset(Core *m) {
    memset(&m->now, 0, sizeof m->now);
    memset(m->shown, 0, sizeof m->shown);
    for (int i = 0; i < N_VARIABLES; i++) {
        const Variable *v = &model_variables[i];
        if (v->kind == KIND_INPUT) m->now.w[v->index] = v->start;
        if (v->kind == KIND_PARAMETER) m->now.p[v->index] = v->start;
    }
    m->now.phase = INSTANTIATED;
    m->stale = 1;
}

static int known(Core *m, unsigned reference, int type, const char *what) {
    if (reference >= N_VARIABLES)
        return core_say(m, ERROR, "there is no variable with value reference %u to %s", reference, what);
    if (model_variables[reference].type != type)
        return core_say(m, ERROR, "variable '%s' is %s; it cannot be %s as another type", model_variables[reference].name,
                        model_variables[reference].type == TYPE_REAL ? "a real number" : "a boolean", what);
    return OK;
}

/* Newton's method for the place where the load hangs still, from the plain machine's own equilibrium. */
static int hang_still(Core *m) {
    enum { Q = N_POSITIONS, N = N_POSITIONS };
    State *now = &m->now;
    double out[N * (N + 1)], a[N][N + 1];
    for (int round = 0; round <= ROUNDS; round++) {
        int still = 1;
        double rest[N_STATES];
        memcpy(rest, now->s, sizeof rest);
        for (int i = Q; i < 2 * Q; i++) rest[i] = 0.0;
        model_balance(m->c, now->time, now->hold, rest, out);
        for (int i = 0; i < N; i++) still = still && fabs(out[i]) <= AT_REST;
        if (still) return OK;
        if (round == ROUNDS) break;
        for (int i = 0; i < N; i++) {
            for (int j = 0; j < N; j++) a[i][j] = out[N + i * N + j];
            a[i][N] = out[i];
        }
        for (int k = 0; k < N; k++) { /* Gauss with pivots */
            int best = k;
            for (int i = k + 1; i < N; i++)
                if (fabs(a[i][k]) > fabs(a[best][k])) best = i;
            if (!(fabs(a[best][k]) > 0.0)) return ERROR;
            for (int j = 0; j <= N; j++) { double x = a[k][j]; a[k][j] = a[best][j]; a[best][j] = x; }
            for (int i = 0; i < N; i++)
                if (i != k) {
                    double f = a[i][k] / a[k][k];
                    for (int j = k; j <= N; j++) a[i][j] -= f * a[k][j];
                }
        }
        for (int i = 0, j = 0; i < Q; i++) /* the placed position is given, so its column is the input's */
            if (i != PLACED) { now->s[i] -= a[j][N] / a[j][j]; j++; }
        now->hold -= a[N - 1][N] / a[N - 1][N - 1];
    }
    return ERROR;
}

/* From parameters to the state at the start: hanging still at the start position, or moving evenly from there. */
static int place(Core *m) {
    State *now = &m->now;
    model_constants(now->p, m->c);
    model_first(m->c, now->p[START_AT], now->p[START_SPEED], now->s, &now->hold);
    now->time = now->start_time;
    if (hang_still(m) != OK)
        return core_say(m, ERROR, "no place of rest was found at the start position %g: the load cannot hang there",
                        now->p[START_AT]);
    now->sample = 0;
#if N_MEMORY > 0
    now->actual = now->command = now->hold;
    model_control_start(m->c, now->hold, now->s[0], now->memory);
#else
    if (!now->given) now->w[0] = now->hold; /* nobody has set it: the load is held */
    now->actual = now->w[0];
#endif
    m->stale = 1;
    return OK;
}

int core_enter(Core *m, double start_time, int stop_defined, double stop_time) {
    if (m->now.phase != INSTANTIATED)
        return core_say(m, ERROR, "initialization begins once, after the instance is made or reset");
    if (!isfinite(start_time)) return core_say(m, ERROR, "the start time is %g, expected a finite number", start_time);
    if (stop_defined && !(stop_time > start_time))
        return core_say(m, ERROR, "the stop time %g does not lie after the start time %g", stop_time, start_time);
    m->now.start_time = m->now.time = start_time;
    m->now.phase = INITIALISING;
    return place(m);
}

static int orders_hold(Core *m) {
    for (int i = 0; i < N_ORDERS; i++) {
        const Order *o = &model_orders[i];
        const Variable *a = &model_variables[o->smaller], *b = &model_variables[o->larger];
        double x = m->now.p[a->index], y = m->now.p[b->index];
        if (!(x < y || (o->equal && x == y)))
            return core_say(m, ERROR, "'%s' is %g, expected %s '%s', which is %g", a->name, x,
                            o->equal ? "at most" : "less than", b->name, y);
    }
    return OK;
}

int core_exit(Core *m) {
    if (m->now.phase != INITIALISING) return core_say(m, ERROR, "initialization ends where it has begun");
    if (orders_hold(m) != OK || place(m) != OK) return ERROR;
    m->now.phase = STEPPING;
    return OK;
}

static void show(Core *m) {
    State *now = &m->now;
    if (!m->stale) return;
    model_shown(m->c, now->w, now->time, now->actual, now->s, m->shown);
    m->shown[N_SHOWN - 2] = now->hold;
    m->shown[N_SHOWN - 1] = now->actual;
    m->stale = 0;
}

int core_get(Core *m, unsigned reference, int type, double *value) {
    const Variable *v = &model_variables[reference < N_VARIABLES ? reference : 0];
    if (known(m, reference, type, "read") != OK) return ERROR;
    switch (v->kind) {
    case KIND_TIME: *value = m->now.time; break;
    case KIND_INPUT: *value = m->now.w[v->index]; break;
    case KIND_PARAMETER: *value = m->now.p[v->index]; break;
    default:
        if (m->now.phase == INITIALISING && m->stale && place(m) != OK) return ERROR;
        show(m);
        *value = m->shown[v->index];
    }
    return OK;
}

static int allowed(Core *m, const Variable *v, double value) {
    if (!isfinite(value))
        return core_say(m, DISCARD, "'%s' was given %g, expected a finite number; it stays as it was", v->name, value);
    if (value < v->lowest || (v->above && value <= v->lowest))
        return core_say(m, DISCARD, "'%s' was given %g, expected %s %g; it stays as it was", v->name, value,
                        v->above ? "more than" : "at least", v->lowest);
    if (value > v->highest || (v->below && value >= v->highest))
        return core_say(m, DISCARD, "'%s' was given %g, expected %s %g; it stays as it was", v->name, value,
                        v->below ? "less than" : "at most", v->highest);
    if (v->whole && value != floor(value))
        return core_say(m, DISCARD, "'%s' was given %g, expected a whole number; it stays as it was", v->name, value);
    return OK;
}

int core_set(Core *m, unsigned reference, int type, double value) {
    const Variable *v = &model_variables[reference < N_VARIABLES ? reference : 0];
    int status;
    if (known(m, reference, type, "set") != OK) return ERROR;
    if (v->kind == KIND_TIME || v->kind == KIND_SHOWN)
        return core_say(m, ERROR, "'%s' is no input and no parameter; it cannot be set", v->name);
    if (v->kind == KIND_PARAMETER && !v->tunable && m->now.phase >= STEPPING)
        return core_say(m, ERROR, "parameter '%s' is fixed; set it before the initialization ends", v->name);
    if ((status = allowed(m, v, value)) != OK) return status;
    if (v->kind == KIND_INPUT) {
        m->now.w[v->index] = value;
        if (v->index == 0) { m->now.w_rate = 0.0; m->now.given = 1; }
#if N_MEMORY == 0
        if (v->index == 0) m->now.actual = value;
#endif
    } else {
        m->now.p[v->index] = value;
        if (m->now.phase == STEPPING) model_constants(m->now.p, m->c);
    }
    m->stale = 1;
    return OK;
}

int core_rate(Core *m, unsigned reference, int order, double value) {
    if (reference >= N_VARIABLES || model_variables[reference].kind != KIND_INPUT || model_variables[reference].index != 0 ||
        N_MEMORY > 0)
        return core_say(m, ERROR, "value reference %u takes no derivative as an input", reference);
    if (order != 1) return core_say(m, ERROR, "derivatives of inputs are known up to order 1, not %d", order);
    if (!isfinite(value))
        return core_say(m, DISCARD, "the derivative of '%s' was given %g, expected a finite number", model_variables[reference].name,
                        value);
    m->now.w_rate = value;
    return OK;
}

/* A lag over a step h, as workbench/control/lag.py has it: what is left of a difference at the end of the step, and the
   straight line start + slope t of the same integral and first moment. */
typedef struct {
    double left, start, slope;
} LagStep;

static LagStep lag_step(double lag, double h) {
    LagStep step = {0.0, 0.0, 0.0};
    double x, m0, m1;
    if (!(lag > 0.0)) return step;
    x = h / lag;
    step.left = exp(-x);
    if (x < 0.02) {
        m0 = 1.0 - x / 2.0 + x * x / 6.0 - x * x * x / 24.0 + x * x * x * x / 120.0;
        m1 = 1.0 / 2.0 - x / 3.0 + x * x / 8.0 - x * x * x / 30.0 + x * x * x * x / 144.0;
    } else {
        m0 = (1.0 - step.left) / x;
        m1 = (1.0 - (1.0 + x) * step.left) / (x * x);
    }
    step.start = 4.0 * m0 - 6.0 * m1;
    step.slope = (12.0 * m1 - 6.0 * m0) / h;
    return step;
}

static int bounded(const double *s) {
    for (int i = 0; i < N_STATES; i++)
        if (!(fabs(s[i]) < MOST_STATE)) return 0;
    return 1;
}

/* Equal steps of the plant from `time` over `length`; the input at work is u, u_rate, or nears `command` with a lag.
   ERROR, with the time in now->time, at the first one whose end has no bounds. */
static int cross(Core *m, double time, double length, double u, double u_rate, double lag) {
    State *now = &m->now;
    double next[N_STATES], h;
    int steps = (int)ceil(length / now->p[STEP] - WHOLE);
    LagStep near;
    if (steps < 1) steps = 1;
    h = length / steps;
    near = lag_step(lag, h);
    for (int i = 0; i < steps; i++) {
        double since = i * h, gap = now->actual - now->command;
        if (lag > 0.0) {
            model_step(m->c, now->w, time + since, h, now->command + gap * near.start, gap * near.slope, now->s, next);
            now->actual = now->command + gap * near.left;
        } else {
            model_step(m->c, now->w, time + since, h, u + u_rate * since, u_rate, now->s, next);
        }
        if (!bounded(next)) {
            now->time = time + since + h;
            return ERROR;
        }
        memcpy(now->s, next, sizeof next);
    }
    return OK;
}

#if N_MEMORY > 0
static double lag_of(Core *m) {
    double lag;
    model_lag(m->c, &lag);
    return lag;
}

static void control(Core *m) {
    State *now = &m->now;
    double next[N_MEMORY + 1];
    model_control(m->c, now->w, now->time, now->actual, now->hold, now->s, now->memory, next);
    now->command = next[N_MEMORY];
    memcpy(now->memory, next, N_MEMORY * sizeof *next);
    if (lag_of(m) <= 0.0) now->actual = now->command;
}

/* From sample to sample of the controller; a communication point may lie anywhere between two. */
static int advance(Core *m, double until) {
    State *now = &m->now;
    const double dt = SAMPLE_TIME, same = SAME_TIME * dt, lag = lag_of(m);
    while (until - now->time > same) {
        double here = now->start_time + (double)now->sample * dt, due, length;
        int fresh = now->time > here - same; /* the controller's next step is due */
        if (fresh) {
            now->time = here;
            control(m);
            now->sample++;
        }
        due = now->start_time + (double)now->sample * dt;
        if (due > until + same) {
            length = until - now->time;
            due = until;
        } else {
            length = fresh ? dt : due - now->time;
        }
        if (cross(m, now->time, length, now->command, 0.0, lag) != OK) return ERROR;
        now->time = due;
    }
    now->time = until;
    return OK;
}
#else
static int advance(Core *m, double until) {
    State *now = &m->now;
    double length = until - now->time, u_rate = now->w_rate + now->w[RATE_INPUT];
    if (cross(m, now->time, length, now->w[0], u_rate, 0.0) != OK) return ERROR;
    now->actual = now->w[0] + u_rate * length;
    now->w_rate = 0.0;
    now->time = until;
    return OK;
}
#endif

int core_step(Core *m, double from, double length) {
    State *now = &m->now;
    State before;
    if (now->phase != STEPPING) return core_say(m, ERROR, "a step was asked for outside of the stepping phase");
    if (!isfinite(from) || !isfinite(length))
        return core_say(m, ERROR, "a step from %g s over %g s was asked for, expected finite numbers", from, length);
    if (!(length > 0.0))
        return core_say(m, ERROR, "a step of %g s was asked for at %g s; time only goes forward", length, from);
    if (fabs(from - now->time) > SAME_TIME * length + 1e-12 * fabs(now->time))
        return core_say(m, ERROR, "a step from %.9g s was asked for, but the model is at %.9g s; restore a stored state to go back",
                        from, now->time);
    if (length > MOST_STEPS * now->p[STEP])
        return core_say(m, ERROR, "a step of %g s was asked for, expected at most %g s", length, MOST_STEPS * now->p[STEP]);
    memcpy(&before, now, sizeof before);
    if (advance(m, from + length) != OK) {
        double at = now->time;
        memcpy(now, &before, sizeof before);
        m->stale = 1;
        return core_say(m, ERROR, "the state grew without bound at %.9g s; the step from %g s over %g s was taken back", at, from,
                        length);
    }
    m->stale = 1;
    return OK;
}

static int position(const int *list, int n, unsigned reference) {
    for (int i = 0; i < n; i++)
        if ((unsigned)list[i] == reference) return i;
    return -1;
}

int core_derivative(Core *m, const unsigned *unknowns, size_t n, const unsigned *knowns, size_t k, const double *seed,
                    double *sensitivity, int adjoint) {
#if N_KNOWNS > 0
    double slopes[N_UNKNOWNS * N_KNOWNS];
    State *now = &m->now;
    if (now->phase == INITIALISING && m->stale && place(m) != OK) return ERROR;
    model_slopes(m->c, now->w, now->time, now->actual, now->s, slopes);
    for (size_t i = 0; i < (adjoint ? k : n); i++) sensitivity[i] = 0.0;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < k; j++) {
            int row = position(model_unknowns, N_UNKNOWNS, unknowns[i]), column = position(model_knowns, N_KNOWNS, knowns[j]);
            if (row < 0) return core_say(m, ERROR, "no derivatives are known of value reference %u", unknowns[i]);
            if (column < 0) return core_say(m, ERROR, "no derivatives are known by value reference %u", knowns[j]);
            sensitivity[adjoint ? j : i] += slopes[row * N_KNOWNS + column] * seed[adjoint ? i : j];
        }
    return OK;
#else
    (void)unknowns, (void)n, (void)knowns, (void)k, (void)seed, (void)sensitivity, (void)adjoint;
    return core_say(m, ERROR, "directional derivatives are not known where the controller is inside");
#endif
}

int core_restore(Core *m, const State *state) {
    memcpy(&m->now, state, sizeof m->now);
    model_constants(m->now.p, m->c);
    m->stale = 1;
    return OK;
}
