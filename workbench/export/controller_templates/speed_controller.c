/* {{ title }} */
#include "speed_controller.h"

#include <math.h>

{% for number in program.numbers %}
static const double {{ number.name }} = {{ number.value }}; /* {{ number.meaning }} */
{% endfor %}

/* The last torque, as far as the motors that are left give it; a torque that is none is not held. */
static double held(speed_controller *m, int motor_failed) {
    const double most = motor_failed ? torque_limit_one_failed_nm : torque_limit_nm;
    m->fault = 1;
    m->limited = 0;
    if (!(fabs(m->torque_motor_nm) <= torque_limit_nm)) m->torque_motor_nm = 0.0;
    m->torque_motor_nm = fmin(fmax(m->torque_motor_nm, -most), most);
    return m->torque_motor_nm;
}

void speed_controller_init(speed_controller *m) {
    m->torque_motor_nm = 0.0;
    speed_controller_reset(m, 0.0);
}

void speed_controller_reset(speed_controller *m, double torque_hold_nm) {
    m->fault_reason = 0;
    m->fresh = 1;
    m->speed_before = 0.0;
{% for name in program.memory %}
    m->{{ name }} = 0.0;
{% endfor %}
    if (!({{ hold.holds | c }})) {
        m->fault_reason = {{ hold.reason }};
        held(m, 0);
        return;
    }
{% for line in program.reset %}
    {{ line | c_line }}
{% endfor %}
    m->torque_motor_nm = torque_hold_nm;
    m->limited = 0;
    m->fault = 0;
}

double speed_controller_step(speed_controller *m, double speed_reference_rad_s, double speed_motor_rad_s,
                             int motor_failed) {
    const double reference = speed_reference_rad_s, speed = speed_motor_rad_s;
    double {{ program.locals | join(", ") }};
    if (m->fault) return held(m, motor_failed);
{% for check in program.before %}
    {{ "" if loop.first else "else " }}if (!({{ check.holds | c }})) m->fault_reason = {{ check.reason }};
{% endfor %}
    if (m->fault_reason) return held(m, motor_failed);
{% for title, lines in program.step %}
    /* {{ title }} */
{% for line in lines %}
    {{ line | c_line }}
{% endfor %}
{% endfor %}
    if (!({{ result.holds | c }})) {
        m->fault_reason = {{ result.reason }};
        return held(m, motor_failed);
    }
    m->speed_before = speed;
    m->fresh = 0;
    m->torque_motor_nm = command;
    m->limited = command != wanted;
    return command;
}
