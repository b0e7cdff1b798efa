/* {{ title }}
   SI units; hoisting is positive; torque is that of all motors together. */
#ifndef SPEED_CONTROLLER_H
#define SPEED_CONTROLLER_H

#ifdef __FAST_MATH__
#error "the checks compare with NaN: compile without -ffast-math"
#endif

typedef struct {
    /* memory, set by speed_controller_reset */
{% for name in program.memory + ["speed_before"] %}
    double {{ name }};
{% endfor %}
    int fresh;              /* no sample since the reset */
    double torque_motor_nm; /* the last command */
    int limited;            /* the command is at a limit */
    int fault;              /* a check failed: the last torque is held until a reset; wire it to the brake */
    int fault_reason;       /* 0: none; else */
{% for check in checks %}
    /* {{ check.reason }}: {{ check.meaning }} */
{% endfor %}
} speed_controller;

void speed_controller_init(speed_controller *m);
/* Takes over a load that torque_hold_nm holds, without a bump, and ends a fault. Call it before the first step. */
void speed_controller_reset(speed_controller *m, double torque_hold_nm);
/* One sample: call it every sample_time_s. Returns the torque command, N m. */
double speed_controller_step(speed_controller *m, double speed_reference_rad_s, double speed_motor_rad_s,
                             int motor_failed);

#endif
