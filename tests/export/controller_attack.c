/* A million random and extreme calls of an exported controller, with an oracle of its own: it knows the ranges, not how
   they are checked. xorshift64* makes the numbers. LIMIT, ONE, WEAK, SPEED, STEP come from the command line. */
#include <stddef.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include "speed_controller.h"
static uint64_t x = 88172645463325252ull;
static uint64_t next(void) { x ^= x >> 12; x ^= x << 25; x ^= x >> 27; return x * 2685821657736338717ull; }
static double uniform(double low, double high) {
    return low + (high - low) * (double)(next() >> 11) / 9007199254740992.0;
}
static double extreme(void) {
    static const double values[] = {NAN, -NAN, INFINITY, -INFINITY, 1e308, -1e308, 5e-324, 0.0, -0.0, SPEED, -SPEED,
                                    1.0000001 * SPEED, 1e9, -1e9, 1e300, 1.5, 300.0};
    double v; uint64_t bits = next();
    if (next() % 3 == 0) { memcpy(&v, &bits, sizeof v); return v; }
    return values[next() % (sizeof values / sizeof *values)];
}
static int bad(const char *what, long k) { printf("%s at call %ld\n", what, k); return 1; }
int main(void) {
    speed_controller m; double speed = 0.0; int fresh = 1, spoilt = 0; long faults = 0, sound = 0;
    speed_controller_init(&m);
    for (long k = 0; k < 1000000; k++) {
        int wild = next() % 50 == 0, failed = next() % 7 == 0, was = m.fault;
        double reference, w, u, before = m.torque_motor_nm;
        if (next() % (was ? 4 : 300) == 0) {
            double hold = next() % 5 ? uniform(-LIMIT, LIMIT) : extreme();
            speed_controller_reset(&m, hold);
            if (!(fabs(m.torque_motor_nm) <= LIMIT)) return bad("reset: torque", k);
            if (m.fault != !(fabs(hold) <= LIMIT)) return bad("reset: fault", k);
            if (m.fault && m.fault_reason != 1) return bad("reset: reason", k);
            fresh = 1;
            spoilt = 0; /* until here a hit may show */
            continue;
        }
        if (next() % 2000 == 0) { /* the memory itself is hit: any of its numbers */
            double hit = next() % 2 ? NAN : extreme();
            size_t place = next() % (offsetof(speed_controller, fresh) / sizeof hit + 1);
            if (place < offsetof(speed_controller, fresh) / sizeof hit)
                memcpy((char *)&m + place * sizeof hit, &hit, sizeof hit);
            else m.torque_motor_nm = hit;
            spoilt = 1;
        }
        reference = wild && next() % 2 ? extreme() : uniform(-SPEED, SPEED);
        w = wild ? extreme() : fmin(fmax(speed + uniform(-0.99, 0.99) * STEP, -SPEED), SPEED);
        if (next() % 500 == 0) w = speed + 1.01 * STEP;
        u = speed_controller_step(&m, reference, w, failed);
        if (!(fabs(u) <= (failed ? ONE : LIMIT) * (1 + 1e-12))) return bad("torque beyond its limit", k);
        if (u != m.torque_motor_nm) return bad("torque returned is not the one kept", k);
        if (m.fault != (m.fault_reason != 0)) return bad("flag without reason", k);
        if (was && !m.fault) return bad("a fault left without a reset", k);
        if (!m.fault && fabs(w) > WEAK && !(fabs(u) <= (failed ? ONE : LIMIT) * WEAK / fabs(w) * (1 + 1e-12)))
            return bad("torque beyond the weakened field's limit", k);
        if (m.fault && !spoilt && !was && u != fmin(fmax(before, -(failed ? ONE : LIMIT)), failed ? ONE : LIMIT))
            return bad("the last torque is not held", k);
        if (!was && !spoilt) {
            int ok = fabs(reference) <= SPEED && fabs(w) <= SPEED && (fresh || fabs(w - speed) <= STEP);
            if (ok == m.fault) return bad(ok ? "a fault without a cause" : "a cause without a fault", k);
            sound += ok; faults += !ok;
        }
        if (!m.fault) { speed = w; fresh = 0; }
    }
    printf("%ld sound, %ld faults\n", sound, faults);
    return !(sound > 100000 && faults > 1000);
}
