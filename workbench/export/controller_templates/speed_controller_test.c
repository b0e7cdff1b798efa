/* Self-test of: {{ title }}
   Inputs and the torque that the controller of the studies gives. Exit status 0: they agree. */
#include "speed_controller.h"

#include <math.h>
#include <stdio.h>

static const struct { double reference, speed; int failed; double torque; } record[] = {
{% for reference, speed, failed, torque in rows %}
    { {{ reference }}, {{ speed }}, {{ failed | int }}, {{ torque }} }{{ "" if loop.last else "," }}
{% endfor %}
};

int main(void) {
    speed_controller m;
    double worst = 0.0;
    const int n = (int)(sizeof record / sizeof record[0]);
    speed_controller_init(&m);
    speed_controller_reset(&m, {{ record.hold_nm }});
    for (int k = 0; k < n; k++) {
        double torque = speed_controller_step(&m, record[k].reference, record[k].speed, record[k].failed);
        worst = fmax(worst, fabs(torque - record[k].torque));
    }
    printf("%d samples, largest difference %.3g N m, fault %d\n", n, worst, m.fault_reason);
    return worst <= {{ tolerance_nm }} && !m.fault ? 0 : 1;
}
